"""Keepers: the sites themselves, as processes that hold, show and change them, and decide nothing.

Runs without rounds have them, since silence means nothing there and an empty site has nobody to
speak for it. It imports the protocol alone: nothing about rules, views and modules.
"""
