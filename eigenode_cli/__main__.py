"""`python -m eigenode_cli` is the same command as `eigenode`."""

import sys

from eigenode_cli.cli import main

if __name__ == "__main__":
    sys.exit(main())
