"""Module processes and the fleet that starts, paces and ends them.

It opens sessions and starts processes. It imports `rules`, `local` and the protocol. A run and the
environment over zenoh each use a `LockstepFleet`.
"""
