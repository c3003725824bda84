"""Whether a path of N rounds leads from one state to another, asked of SAT solvers.

It takes a system or a list of actions, and two states: it knows no files, no messages and no kind
of system. From the protocol it imports `core`, from the coordinator `normal_form`. `search`,
`optimality` and `following` use it; `proof_checking` shares nothing with it, and checks its proofs
with separate code.
"""
