"""Plans of other planners, read as moves of the systems here."""
