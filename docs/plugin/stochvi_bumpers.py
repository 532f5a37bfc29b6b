"""Parts for stochvi: a stop that hardens, a profile, a format of files, and a command."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, Self

import click
import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.parts import energy, force, rate, read_law
from stochvi.scenes import Profile, load_scene
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.scenes.validation import Positive

# ------------------------------------------------------------------------------
# A law: what a user writes, and what kernels call.
# ------------------------------------------------------------------------------


class Hardening(CompliantLaw):
    """A stop that hardens, force = stiffness * y + cubic_stiffness * y^3.

    Parameters
    ----------
    stiffness
        k at the first touch, N/m.
    cubic_stiffness
        k3, N/m^3.
    """

    word: ClassVar[str] = "hardening"

    kind: Literal["hardening"] = "hardening"
    stiffness: Positive
    cubic_stiffness: Positive

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Any:
        y = np.maximum(deflection, 0.0)
        return self.stiffness * y + self.cubic_stiffness * y**3

    def potential_at(self, deflection: ArrayLike) -> Any:
        y = np.maximum(deflection, 0.0)
        return self.stiffness * y**2 / 2.0 + self.cubic_stiffness * y**4 / 4.0

    def per_unit_mass(self, mass: float) -> Self:
        return self._times(1.0 / mass, 1.0 / mass)

    def scaled(self, length: float, time: float) -> Self:
        return self._times(time**2, time**2 * length**2)

    def _times(self, stiffness: float, cubic_stiffness: float) -> Self:
        return self.model_copy(
            update={
                "stiffness": self.stiffness * stiffness,
                "cubic_stiffness": self.cubic_stiffness * cubic_stiffness,
            }
        )

    def strengths(self) -> tuple[float, ...]:
        return self.stiffness, self.cubic_stiffness

    def in_words(self) -> str:
        return f"hardening, {self.stiffness:.4g} N/m and {self.cubic_stiffness:.4g} N/m^3"

    def compiled(self) -> Compiled:
        return Compiled(self.stiffness, self.cubic_stiffness)


class Compiled(NamedTuple):
    """The law of kernels, per unit mass."""

    stiffness: float
    cubic: float


@force.of(Compiled)
def _(law, y, v):
    return law.stiffness * y + law.cubic * y * y * y


@energy.of(Compiled)
def _(law, y):
    return 0.5 * law.stiffness * y * y + 0.25 * law.cubic * y * y * y * y


@rate.of(Compiled)
def _(law, y, v, push):
    # at the largest y of this contact: c y^4 / 4 is at most the energy there plus push y, and one
    # of these is at least half of it
    kinetic = 0.5 * v * v + 0.5 * law.stiffness * y * y + 0.25 * law.cubic * y * y * y * y
    scale = 8.0 / law.cubic
    deepest = max((scale * kinetic) ** 0.25, (scale * max(push, 0.0)) ** (1.0 / 3.0))
    return math.sqrt(law.stiffness + 3.0 * law.cubic * deepest**2)


@read_law.of(Compiled)
def _(law, numbers, row):
    return Compiled(numbers[row, 0], numbers[row, 1])


# ------------------------------------------------------------------------------
# A profile, a reader of files, and a command.
# ------------------------------------------------------------------------------


FLAT = Profile(
    name="flat-example", frequency_hz=(20.0, 2000.0), density=(0.01, 0.01), stated_g_rms=4.45,
    source="an example, of no standard",
)  # fmt: skip


def read_f32(path: Path) -> Mapping[str, NDArray[np.float64]]:
    """Columns by their headings: a line of JSON with the headings, then rows of float32."""
    with path.open("rb") as file:
        headings = json.loads(file.readline())
        rows = np.fromfile(file, "<f4").reshape(-1, len(headings))
    return dict(zip(headings, rows.T.astype(float), strict=True))


@click.command()
@click.argument("scene")
@click.option("--height", default=0.1, show_default=True, help="Height of the drop, m.")
def drop(scene: str, height: float) -> None:
    """Tell the peak acceleration of a free drop onto each stop of a scene."""
    found = load_scene(scene)
    mass, speed = found.structure.mass or 1.0, math.sqrt(2.0 * 9.80665 * height)
    for pair in found.impact_pairs:
        for side, law in pair.stops():
            if isinstance(law, CompliantLaw):
                peak = law.impact(speed, mass).peak_force / mass / 9.80665
                click.echo(f"{pair.name} {side}: {peak:.0f} g at {speed:.2f} m/s")
