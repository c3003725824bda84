"""Protocol: what every process agrees on; imports no other room."""
