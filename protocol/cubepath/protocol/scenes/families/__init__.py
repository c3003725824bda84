"""The families of scenes that come with the project, one subject per module; `own` lists all."""
