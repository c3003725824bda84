"""Theory beyond the run: complexes, search, solvers, proofs, following, the paper."""
