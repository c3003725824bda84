"""Scenes drawn as text, pixels and on axes.

It imports the core of the protocol, and no other room of the agents. Environments render with it,
and the coordinator draws runs and complexes.
"""
