"""Whether a rule is local: played under all that must not matter to it, and watched.

It imports `environments`, `rules`, `local` and the protocol. Rules are loaded in processes of their
own alone. The command line asks it.
"""
