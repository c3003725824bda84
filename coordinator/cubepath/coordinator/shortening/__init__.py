"""Paths from files and recordings, shortened, explained, converted and written.

Here a file becomes a path, and a path becomes an answer. It imports `normal_form`, `search` to look
beyond the class, `verification` to check results before they are reported, and the gatherer of
`runs`. The command line is built on it.
"""
