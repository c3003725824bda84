"""Recordings for other tools: tables, and files for viewers in three dimensions.

It imports `shortening` for files of moves, `runs` for where modules are, and `rendering` of the
agents for where they are drawn.
"""
