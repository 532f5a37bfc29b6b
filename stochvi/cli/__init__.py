"""The command line. Nothing heavy is imported before a command needs it."""

# importing a room registers its commands, in the order of the help page
from stochvi.cli import methods, judging, jobs, failing, starting  # isort: skip
from stochvi.cli.shared import main

__all__ = ["failing", "jobs", "judging", "main", "methods", "starting"]
