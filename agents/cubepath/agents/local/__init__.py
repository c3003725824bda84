"""One module's view and choice: observation, arbitration, and the module as a pure machine.

No process, no session, no clock and no random number: the output depends only on the input. It
imports only the protocol. Rules, module processes and environments are built on it; the coordinator
does not use it.
"""
