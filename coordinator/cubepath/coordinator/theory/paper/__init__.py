"""The claims of Abrams and Ghrist, computed one by one.

It imports `complexes` and `normal_form`; only the command line imports it.
"""
