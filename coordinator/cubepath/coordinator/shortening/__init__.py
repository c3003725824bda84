"""Paths from files and recordings, shortened, explained, converted and written.

Here a file becomes a path, and a path becomes an answer. It imports `normal_form`, `verification`
to check results before they are reported, and the gatherer of `runs`. `theory` goes beyond the
class. The command line is built on it.
"""
