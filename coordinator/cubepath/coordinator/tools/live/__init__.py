"""A run as a page that is fed while the run is under way, by a small HTTP server on this machine.

It imports `viewing` for the page, `runs` for the runs that are watched, and `normal_form`.
"""
