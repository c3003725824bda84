"""How far a shortened path is from the best: better paths, bounds, proofs of optimality."""
