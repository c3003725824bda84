"""Scenes by name or from TOML files, and the families of scenes.

`scene_from_spec` is the one way from a text to a scene. Families are found by entry points,
including those defined here; `random_scenes` has what some of them draw from a seed. It imports
`systems` and `core`. All code that gets a scene from a user, a file or a recording asks here.
"""
