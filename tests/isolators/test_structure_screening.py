"""Linear screening of structures, against one oscillator after the other."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from stochvi import (
    Isolator,
    Matrices,
    NotApplicable,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    screen,
)
from stochvi.isolators.structure_screening import StructureScreening
from support.commands import Run, one_document
from support.pairs import diagonal, pair, uncoupled

TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz", on="base")
MOUNTS = {"a": (8.0, 0.05), "b": (12.0, 0.1), "c": (30.0, 0.2)}
"""Natural frequency in hertz, and damping ratio."""


def side_by_side() -> Scene:
    omega = [2.0 * math.pi * frequency for frequency, _ in MOUNTS.values()]
    rates = [2.0 * zeta * w for w, (_, zeta) in zip(omega, MOUNTS.values(), strict=True)]
    return Scene(
        structure=Matrices(
            coordinates=tuple(MOUNTS),
            mass=diagonal(1.0, 1.0, 1.0),
            damping=diagonal(*rates),
            stiffness=diagonal(*(w**2 for w in omega)),
        ),
        impact_pairs=[pair(name, name, 0.01) for name in MOUNTS],
        excitations=[TRUCK],
    )


def test_mounts_side_by_side_are_mounts_alone() -> None:
    found = screen(side_by_side())
    assert isinstance(found, StructureScreening)
    for name, (frequency, zeta) in MOUNTS.items():
        alone = screen(
            Scene(structure=Isolator(frequency_hz=frequency, zeta=zeta), excitations=[TRUCK])
        )
        own, gap = found.coordinates[name], found.impact_pairs[name]
        for quantity in ("displacement_std", "velocity_std", "acceleration_std"):
            assert getattr(own, quantity) == pytest.approx(getattr(alone, quantity), rel=1e-9)
        assert own.zero_crossing_rate == pytest.approx(alone.zero_crossing_rate, rel=1e-9)
        assert gap.displacement_std == own.displacement_std
        assert gap.rice_rate == pytest.approx(alone.rice_rate(0.01), rel=1e-6)
        assert gap.three_sigma_rate == pytest.approx(alone.rice_rate(gap.three_sigma), rel=1e-9)


def test_gaps_between_coordinates_and_loads() -> None:
    found = screen(uncoupled(pair("between", None, 3.0, ("x", "z"))))
    gap = found.impact_pairs["between"]
    assert gap.displacement_std == pytest.approx(math.sqrt(2.0), rel=1e-9)
    assert gap.velocity_std == pytest.approx(math.sqrt(5.0), rel=1e-9)
    assert gap.stops == {"lower": 3.0, "upper": 3.0}
    # noise on the masses themselves has no acceleration without it
    assert found.coordinates["x"].acceleration_std is None


def test_a_coordinate_at_rest_has_no_zero_crossings() -> None:
    scene = uncoupled(pair("z", "z", 3.0)).model_copy(
        update={"excitations": (WhiteNoise(intensity=0.2, on="x"),)}
    )
    found = screen(scene)
    assert found.coordinates["z"].displacement_std == 0.0
    assert found.coordinates["z"].zero_crossing_rate is None
    assert found.impact_pairs["z"].rice_rate == 0.0
    assert np.isfinite(found.coordinates["x"].displacement_std)


def test_a_sine_is_refused() -> None:
    sine = Sine(amplitude=1.0, frequency_hz=1.0, on="x")
    with pytest.raises(NotApplicable, match="got sine"):
        screen(uncoupled(pair("x", "x", 3.0)).model_copy(update={"excitations": (sine,)}))


def test_the_command_of_a_box(stochvi: Run, tmp_path: Path) -> None:
    scene = Path(__file__).parents[2] / "data" / "scenes" / "rigid-box.toml"
    done = stochvi("screen", scene, "--json", "-", "--out", tmp_path)
    assert done.code == 0
    document = one_document(done.out)
    assert document["coordinates"]["z"]["displacement_std"] > 0.0
    assert set(document["impact_pairs"]) == {"corner 1", "corner 2", "side"}
    assert "3 sigma (mm)" in done.err and "mrad rms" in done.err
    assert (tmp_path / "screening.csv").stat().st_size > 0
    assert json.loads(json.dumps(document)) == document
