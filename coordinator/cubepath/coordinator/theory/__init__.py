"""The theory past the run: complexes, search, solvers, proofs, following, the paper."""
