"""Rules: how a module chooses from what it sees, built in or from other distributions.

A rule receives a `View` and returns a `Choice`. An `Actor` asks a rule for one module, and
`VectorActors` for all modules of many environments, if the rule has that form. It imports `local`,
the protocol and, from `keepers`, what an attempt needs. Module processes and environments let rules
act; the coordinator asks for them by name.
"""
