"""Kinds of systems: on a lattice, on a graph, move by move, and flips of diagonals."""
