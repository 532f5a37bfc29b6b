"""`python -m stochvi`."""

from stochvi.cli import main

main(prog_name="stochvi")
