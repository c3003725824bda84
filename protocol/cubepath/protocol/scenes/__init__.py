"""Scenes by name or from TOML files, and the built-in families of scenes."""
