"""The commands that `tools` adds to the command line."""
