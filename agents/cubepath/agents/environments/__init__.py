"""The PettingZoo environments, in one process and over zenoh, and playing a rule in them.

It imports all other rooms of the agents, and the protocol. It is for outside users; in the project
only the simulator imports it, to compare its runs with `play`, `locality`, and experiments, which
play runs in it.
"""
