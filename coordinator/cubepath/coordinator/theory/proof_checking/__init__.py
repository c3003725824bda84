"""Timetables and proofs checked by code that shares nothing with what finds them.

Of the coordinator it imports `verification` and the definitions of `normal_form` alone.
"""
