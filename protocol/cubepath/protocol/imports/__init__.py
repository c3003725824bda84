"""Plans of other programs: each format in a module of its own, all read into one `Imported`."""
