"""Keepers: processes that hold, show and change the sites, and decide nothing.

Runs without rounds need them: silence carries no information there, and an empty site has no module
to answer for it. Keepers import only the protocol; they know nothing of rules, views or modules.
"""
