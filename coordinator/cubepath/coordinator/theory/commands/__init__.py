"""The commands and options that `theory` adds to the command line."""
