"""Two runs compared: where they part, and why.

It reads recordings with what `verification` sorts them by, asks rules again as `auditing` does, and
compares paths by `verification.dependencies`. The command line and the assertions of `testing` use
it.
"""
