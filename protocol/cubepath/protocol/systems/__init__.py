"""Kinds of systems: on a lattice, on a graph, move by move, and flips of diagonals.

Each class describes itself completely: its moves, what a module senses, how it is written, drawn
and bounded. Two of them are built on graphs and point sets. It imports only `core`. Scenes are made
of these classes, and plans of other planners are read as their moves; all other code takes a
`System` and asks for no class.
"""
