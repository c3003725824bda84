"""Run the command line as ``python -m cubepath``."""

import sys

from cubepath.coordinator.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
