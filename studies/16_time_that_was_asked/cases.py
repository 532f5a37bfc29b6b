"""Commands, questions and scenes whose time is measured."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from numba.core import config

import stochvi
from stochvi.cli import main
from stochvi.scenes.datasets import shipped_scene, zoo_files

TIGHT = ("--rel-error", "1e-3")
"""An accuracy that no budget here reaches, so that the budget is what ends the command."""

QUESTIONS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "simulate": {"": TIGHT, "--paths": ("--paths", "100000", "--duration", "1000")},
    "spectrum": {"": TIGHT},
    "impacts": {"": TIGHT},
    "damage": {"": ("--mission", "3600", *TIGHT)},
    "clearance": {"": TIGHT},
    "size": {
        "--probability": ("--probability", "0.01", *TIGHT),
        "--rate": ("--rate", "0.01", *TIGHT),
        "--impact-speed": ("--impact-speed", "0.5", *TIGHT),
        "--peak-acceleration": ("--peak-acceleration", "40g", *TIGHT),
        "--sensitivity": ("--rate", "0.01", "--sensitivity"),
        "report": ("--peak-acceleration", "40g"),
    },
    "reliability": {
        "": ("--mission", "3600", *TIGHT),
        "--impact-speed": ("--mission", "3600", "--impact-speed", "0.5", *TIGHT),
        "--peak-acceleration": ("--mission", "3600", "--peak-acceleration", "40g", *TIGHT),
        "beyond reach": ("--mission", "3600", "--impact-speed", "1000"),
    },
    "absorber": {"": TIGHT, "--mass-budget": ("--mass-budget", "0.1", *TIGHT)},
    "sine": {"": ("--from", "0.5", "--to", "20", "--points", "2000")},
    "basins": {"": ("--periods", "10000")},
    "bifurcation": {"": ("--from", "0.5", "--to", "20", "--points", "4000")},
    "lifetimes": {"": TIGHT},
    "growth": {"": TIGHT},
    "perturbations": {"": ("--speeds", "0.1,0.2,0.3", "--paths", "100000")},
    "check": {"": TIGHT},
    "cost": {"": ()},
    "exact": {"": ()},
    "linearise": {"": ()},
    "average": {"": ()},
    "screen": {"": ()},
    "fokker-planck": {"": ("--rtol", "1e-12")},
    "first-passage": {"": ("--mission", "3600", "--rtol", "1e-12")},
    "history": {"": ("--duration", "20000")},
    "replay": {"": ()},
    "explain": {"": ()},
    "sweep": {
        "simulate": TIGHT,
        "size": ("--method", "size", "--probability", "0.01", *TIGHT),
        "reliability": ("--method", "reliability", "--mission", "3600", *TIGHT),
    },
}
"""What is asked of each command with a budget, by a name for the question."""

WITHOUT_BUDGET = {
    "profiles", "new", "demo", "problems", "judge", "schema", "identify", "shocks",
    "explore",
}  # fmt: skip
"""Commands that have no budget: what is asked of them bounds their work."""


class Case(NamedTuple):
    """One question to one command, and whether the command has a budget."""

    command: str
    question: str
    arguments: tuple[str, ...]
    budgeted: bool


def cases() -> Iterator[Case]:
    """Every question to every command; `RuntimeError` where a command of the program has none."""
    known = {*QUESTIONS, *WITHOUT_BUDGET}
    if forgotten := main.commands.keys() - known:
        raise RuntimeError(f"{', '.join(sorted(forgotten))} has no question in cases.py")
    for name, command in main.commands.items():
        has_budget = any(option.name == "budget" for option in command.params)
        if has_budget != (name in QUESTIONS):
            raise RuntimeError(f"{name} stands on the wrong list of cases.py")
        for question, arguments in QUESTIONS.get(name, {}).items():
            yield Case(name, question, arguments, True)


def vary(scene: Path) -> str:
    """Two values of a key that the scene has, for a sweep."""
    structure = tomllib.loads(scene.read_text("utf-8"))["structure"]
    key = "zeta" if "zeta" in structure else "damping"
    place = ".0.0" if structure["kind"] == "matrices" else ""
    value = structure[key] if not place else structure[key][0][0]
    return f"structure.{key}{place}={value},{1.5 * value}"


def last_compiled() -> float:
    """Time at which a kernel was compiled last: where the package keeps its machine code."""
    places = [
        Path(stochvi.__file__).parent,
        *([Path(config.CACHE_DIR)] if config.CACHE_DIR else []),
    ]
    kernels = (file for place in places for file in place.rglob("*.nbc"))
    return max((file.stat().st_mtime for file in kernels), default=0.0)


SHIPPED = {
    "absorber in a box": "absorber-in-a-box",
    "truck, table stops": "isolator-bumper",
    "white noise, lossy": "oscillator-lossy",
    "record": "isolator-record",
}
"""Scenes that ship, by the names of this study."""

OWN = {"truck, rubber stops": "rubber.toml", "hammer": "hammer.toml"}
"""Scenes of this study: the isolator that is sized for 40 g, and a light mass without a spring that
a load presses onto an inelastic stop of a shaken body."""


def scenes() -> dict[str, Path]:
    """Scene files by name."""
    shipped = {name: shipped_scene(file) for name, file in SHIPPED.items()}
    own = {name: Path(__file__).parent / file for name, file in OWN.items()}
    return shipped | {"three masses": zoo_files()["chain-lossy-pairs"]} | own
