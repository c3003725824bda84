"""Plans whose vehicles may follow one another: their least timetables, and optima of small ones.

Moves that follow do not commute, so nothing here is a cube: it imports neither shortening nor
complexes, and these know nothing of it. `proof_checking` checks the results, and the solvers are
those of `satisfiability`.
"""
