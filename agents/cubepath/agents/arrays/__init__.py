"""Lockstep worlds as arrays: the tables of a scene, and compiled kernels over them.

It imports `local` and the protocol. `environments` builds on it.
"""
