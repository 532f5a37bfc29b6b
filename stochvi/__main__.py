"""The program `stochvi`, also as `python -m stochvi`."""

import atexit
import gc
import sys


def run() -> None:
    """Run the command line; Ctrl-C while it is being imported ends in a sentence, too."""
    if sys.flags.optimize > 1:
        sys.stderr.write("stochvi: commands need their docstrings; start Python without -OO\n")
        sys.exit(2)
    # what is left at the end goes with the process: to look for cycles in it takes half a second
    atexit.register(gc.freeze)
    try:
        from stochvi.cli import main

        main(prog_name="stochvi")
    except KeyboardInterrupt:
        sys.stderr.write("stochvi: interrupted by Ctrl-C; nothing was kept\n")
        sys.exit(1)


if __name__ == "__main__":
    run()
