"""Two runs compared: where they part, and why.

It sorts the messages of recordings with `verification`, asks rules again as `auditing` does, and
compares paths with `verification.dependencies`. The command line and the assertions of `testing`
use it.
"""
