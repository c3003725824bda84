"""One module's view and choice: observation, arbitration, and the module as a pure machine."""
