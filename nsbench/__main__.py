"""Run the command line by `python -m nsbench`."""

from nsbench.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
