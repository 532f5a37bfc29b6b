"""The command line. Nothing heavy is imported before a command needs it."""

# each module registers its commands, in the order of the help page
from stochvi.cli import methods, verification  # isort: skip
from stochvi.cli import isolators  # isort: skip
from stochvi.cli import sine  # isort: skip
from stochvi.cli import scenes  # isort: skip
from stochvi.cli.program import main

__all__ = ["isolators", "main", "methods", "scenes", "sine", "verification"]
