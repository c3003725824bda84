"""The recording format in MCAP: writing, reading and salvaging it.

It imports `wire` for the messages, `scenes` for the scene in a recording, and `core`. The
coordinator writes and reads recordings; modules know nothing of them.
"""
