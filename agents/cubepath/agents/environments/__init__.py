"""The PettingZoo environments, in one process and over zenoh, and ways to play a rule in them.

It imports all other rooms of the agents, and the protocol. It is meant for users. Inside the
project, three rooms import it: the simulator, to compare its runs with `play`; `locality`; and
experiments, which play runs in it.
"""
