"""Scenes drawn as text, pixels and on axes."""
