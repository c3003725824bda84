"""A run as a page that is fed while it goes on, by a small HTTP server on this machine alone.

It imports `viewing` for the page, `runs` for the runs that are watched, and `normal_form`.
"""
