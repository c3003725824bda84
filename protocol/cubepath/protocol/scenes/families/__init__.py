"""The families of scenes that come with the project, one subject a module; `own` has them all."""
