"""Recording a run from outside: attach where it can be listened to, record, and leave.

It imports `runs` for what a run says about itself; it starts no run and decides nothing for one.
Like any guest, it may only listen.
"""
