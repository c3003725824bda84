"""Coordinator: the global view, from launching a run to its shortest schedule and its record."""
