"""The claims of Abrams and Ghrist, computed one by one."""
