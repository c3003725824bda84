"""Beyond the homotopy class: exact optima, lower bounds and shorter paths.

It takes a system, two states and a path between them; it knows nothing of files and messages. It
imports `complexes`, to find out whether there is only one class, `satisfiability`, to ask for
shorter windows of a path, and `normal_form`. `optimality` uses it.
"""
