"""Run the command line as ``python -m cubepath.coordinator``."""

import sys

from cubepath.coordinator.commands.entry import entry

if __name__ == "__main__":
    sys.exit(entry())
