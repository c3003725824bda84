"""The recording format in MCAP: writing, reading and salvaging it."""
