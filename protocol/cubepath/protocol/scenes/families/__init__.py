"""The built-in families of scenes, one subject a module."""
