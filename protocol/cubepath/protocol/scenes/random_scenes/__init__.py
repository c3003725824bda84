"""What random scenes are made of: a stream of our own, shapes, graphs, triangulations, walks."""
