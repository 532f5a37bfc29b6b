"""The program `stochvi`, also as `python -m stochvi`."""

import sys


def run() -> None:
    """Run the command line; Ctrl-C while it is being imported ends in a sentence, too."""
    try:
        from stochvi.cli import main

        main(prog_name="stochvi")
    except KeyboardInterrupt:
        sys.stderr.write("stochvi: interrupted by Ctrl-C; nothing was kept\n")
        sys.exit(1)


if __name__ == "__main__":
    run()
