"""Paths from files and recordings, shortened, explained, converted and written."""
