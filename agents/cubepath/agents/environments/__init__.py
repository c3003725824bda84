"""The PettingZoo environments, in one process and over zenoh."""
