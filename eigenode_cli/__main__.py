"""`python -m eigenode_cli` is the same command as `eigenode`."""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        sys.path.append(sys.path.pop(0))  # the current folder, which `-m` puts first: no file there hides a module
    from eigenode_cli.cli import main

    sys.exit(main())
