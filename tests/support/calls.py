"""Calls of public functions and classes with wrong and extreme arguments, chosen with a seed."""

from __future__ import annotations

import functools
import importlib
import inspect
import random
from collections.abc import Callable
from typing import Any

import numpy as np

from stochvi import load_scene, size
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.scene import Scene
from support.mutations import NAMES, NUMBERS, WRONG

ROOMS = (
    "", ".scenes", ".statistics", ".isolators", ".absorbers", ".identification", ".verification",
    ".testing", ".methods.periodic", ".methods.closed_form", ".methods.linearisation",
    ".methods.fokker_planck", ".methods.monte_carlo", ".mathematics.kelvin_voigt",
)  # fmt: skip

OF_MODELS = {"unmet", "unmet_by_first_passage", "unmet_by_transient"}
"""Functions of a `Model`, which no user makes."""

SECONDS = 0.2
"""Budget of every call, s."""

EXTREMES: tuple[Any, ...] = (
    *NUMBERS, *NAMES, *WRONG, 10**400, 1e-300, 1e300, None, object(), len, b"\x00", (), range(3),
    {1},
    np.zeros(0), np.full(3, np.nan), np.array([1.0, np.inf]), np.zeros((2, 2)), np.float32(2.0),
    np.int8(-1), 1j, [10**400], ["a", 1.0], [-1.0, 0.0, 1e300], {"x": [1.0]}, Scene,
)  # fmt: skip
"""What an argument may be instead."""

SHIPPED = ("oscillator-lossy", "isolator-bumper", "isolator-sine", "absorber-in-a-box", "rigid-box")


@functools.cache
def scenes() -> tuple[Scene, ...]:
    """Scenes of several kinds."""
    return tuple(load_scene(shipped_scene(name)) for name in SHIPPED)


@functools.cache
def sizing() -> Any:
    """A sizing, for what begins with one."""
    return size(scenes()[0], probability=0.1, mission=60.0, rel_error=0.3, budget=2.0, threads=1)


@functools.cache
def callables() -> tuple[Callable[..., Any], ...]:
    """Public functions, and the public classes of which scenes are made."""
    found = {}
    for room in ROOMS:
        package = importlib.import_module(f"stochvi{room}")
        for name in getattr(package, "__all__", ["identify_viscoelastic"]):
            each = getattr(package, name)
            of_scene = inspect.isclass(each) and each.__module__.startswith("stochvi.scenes")
            if (inspect.isfunction(each) and name not in OF_MODELS) or of_scene:
                found[name] = each
    return tuple(found[name] for name in sorted(found))


GIVEN: dict[str, Any] = {
    "mission": 60.0, "duration": 2.0, "times": [1.0, 2.0], "clearances": [0.002, 0.003],
    "speeds": [0.1], "vary": {"structure.damping": [0.1, 0.2]}, "lag": [0.0, 1.0], "x": [0.0, 0.5],
    "mass_budget": 0.1, "carrier": "x", "mass": 0.1, "omega": 1.0, "damping_rate": 0.1,
    "intensity": 0.2, "damping": 0.1, "stiffness": 1.0, "absorber_mass": 0.1, "play": 0.5,
    "restitution": 0.7, "force": 1.0, "law": {"kind": "restitution", "coefficient": 0.7},
    "contact_time": 0.01, "time_to_peak": 0.004, "paths": 2, "threads": 1, "budget": SECONDS,
    "path": "missing.csv", "name": "oscillator-lossy", "rel_error": 0.3, "probability": 0.1,
}  # fmt: skip
"""Arguments that a function takes, by their names."""


IN_ROWS: dict[str, dict[str, Any]] = {
    "sweep": {"method": "linearise"}, "mean_over_units": {"threads": 1},
    "mean_over_records": {"threads": 1},
}  # fmt: skip
"""Functions that hand `**arguments` on, among them the budget of each row, and others that they get
here."""


class Caller:
    """Calls at random; the same seed gives the same call."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.function = callables()[seed % len(callables())]
        self.arguments = self._arguments()

    def _arguments(self) -> dict[str, Any]:
        parameters = inspect.signature(self.function).parameters
        of_scene = inspect.isclass(self.function)
        found: dict[str, Any] = {}
        for name, each in parameters.items():
            if each.kind in (each.VAR_KEYWORD, each.VAR_POSITIONAL):
                continue
            needed = each.default is each.empty
            if str(each.annotation).startswith("Scene"):
                found[name] = self.random.choice(scenes())
            elif name == "sizing":
                found[name] = sizing()
            elif name == "scenes":
                found[name] = {"one": self.random.choice(scenes())}
            elif name == "path" and str(each.annotation) == "int":
                continue
            elif name in GIVEN and (
                needed or of_scene or name in ("threads", "budget", "paths", "probability")
            ):
                found[name] = GIVEN[name]
        if "rel_error" in parameters and "paths" not in found:
            found["rel_error"] = 0.3
        if self.function.__name__ in IN_ROWS:
            found |= {"budget": SECONDS} | IN_ROWS[self.function.__name__]
        changeable = [name for name in parameters if name != "budget"]
        for name in self.random.sample(
            changeable, min(self.random.choice((0, 1, 1, 1, 2)), len(changeable))
        ):
            if self.random.random() < 0.1 and name in found:
                del found[name]
            else:
                found[name] = self.random.choice(EXTREMES)
        if "budget" in parameters and self.random.random() < 0.1:
            found["budget"] = self.random.choice(
                (0, -1.0, float("nan"), "60", [], 1e-9, 1j, 1e-300)
            )
        return found

    def __str__(self) -> str:
        shown = ", ".join(f"{name}={value!r:.60}" for name, value in self.arguments.items())
        return f"{self.function.__name__}({shown})"

    def __call__(self) -> Any:
        return self.function(**self.arguments)
