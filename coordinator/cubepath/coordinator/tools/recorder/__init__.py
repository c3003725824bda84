"""Recording a run from outside: attach to it where it can be listened to, and leave.

It imports `runs` for what a run says of itself; it starts no run and decides nothing for one. It
may do what a guest may: listen.
"""
