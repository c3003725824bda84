"""Files of paths: moves, cubes, schedules, durations, timetables, certificates and proofs.

It reads, writes and checks file formats; judging a path is up to the coordinator. It imports only
`core`. Messages carry some of these formats, and all code that takes a path from a file reads it
here.
"""
