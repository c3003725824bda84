"""Rules: what a module chooses from what it sees, built in or from other distributions.

A rule sees a `View` and returns a `Choice`; an `Actor` asks one for one module, and `VectorActors`
for all modules of many environments, if the rule has such a form. It imports `local`, the protocol,
and of `keepers` what an attempt takes. Module processes and environments let rules act; the
coordinator asks for them by name.
"""
