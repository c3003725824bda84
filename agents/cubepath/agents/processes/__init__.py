"""Module processes and the fleet that starts, paces and ends them."""
