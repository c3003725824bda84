"""Past the homotopy class: exact optima, lower bounds and shorter paths."""
