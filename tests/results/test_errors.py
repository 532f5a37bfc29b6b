"""Sentences of errors, whatever the locale of the user."""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from stochvi import ImpactPair, Isolator, Restitution, Scene, WhiteNoise, impacts
from stochvi.cli.program import main
from stochvi.isolators.record_verdict import response_law
from stochvi.model.calculations import calculation
from stochvi.results.errors import (
    Interrupted,
    NotApplicable,
    NotConverged,
    SceneError,
    reason_of,
)
from stochvi.sampling.run import Run
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import scene_from


@pytest.mark.parametrize(
    ("number", "reason"),
    [(errno.ENOENT, "no such file or directory"), (errno.ECONNRESET, "in der sprache des systems")],
)
def test_the_reason_of_a_system_is_said_in_english_where_it_is_known(
    monkeypatch: pytest.MonkeyPatch, number: int, reason: str
) -> None:
    monkeypatch.setattr(os, "strerror", lambda _: "In der Sprache des Systems")
    assert reason_of(OSError(number, "In der Sprache des Systems")) == reason
    assert reason_of(OSError(number, "Our own reason")) == "our own reason"


@pytest.mark.parametrize("kind", [NotConverged, Interrupted])
def test_an_error_carries_what_was_found_and_answers_to_the_former_name(
    kind: type[NotConverged | Interrupted],
) -> None:
    assert kind("too late").partial is None
    error = kind("too late", "so far")
    assert (str(error), error.partial, error.response) == ("too late", "so far", "so far")
    error.response = "more"
    assert error.partial == "more"


FAR = {"kind": "rigid-body", "mass": 5.0, "inertia": [0.05, 0.06, 0.07], "mount": [
    {"at": [x, y, -0.1], "stiffness": [5e3, 5e3, 8e3], "zeta": 0.05}
    for x, y in ((0.1, 0.1), (-0.1, 0.1), (0.1, -0.1), (1e300, -0.1))
]}  # fmt: skip
HIGH = {"kind": "beam", "length": 0.3, "width": 0.02, "height": 1e300, "young": 7e10,
        "density": 2700.0, "zeta": 0.02, "modes": 3}  # fmt: skip
NOISE = [{"kind": "psd", "profile": "mil-std-810h-truck-vertical-5hz"}]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("document", "place"),
    [({"structure": FAR, "excitation": NOISE}, "look at mount.3.at.0 = 1e+300"),
     ({"structure": HIGH, "excitation": NOISE}, "look at height = 1e+300")],
)  # fmt: skip
def test_numbers_beyond_arithmetic_are_named(document: dict[str, Any], place: str) -> None:
    with pytest.raises(SceneError, match="too large, too small or too far apart") as told:
        scene_from(document).structure.matrices()
    assert place in str(told.value)


def test_a_calculation_names_the_number_that_it_overflows_with() -> None:
    @calculation
    def overflowing(scene: Scene) -> float:
        return math.exp(float(scene.excitations[0].intensity))  # type: ignore[union-attr]

    structure = Isolator(frequency_hz=10.0, zeta=0.1)
    scene = Scene(structure=structure, excitations=[WhiteNoise(intensity=1e40)])
    with pytest.raises(NotApplicable, match=r"look at excitation.0.intensity = 1e\+40"):
        overflowing(scene)
    mild = Scene(structure=structure, excitations=[WhiteNoise(intensity=2e3)])
    with pytest.raises(NotApplicable, match="too far apart to calculate with") as told:
        overflowing(mild)
    assert "look at" not in str(told.value)


def test_one_path_of_impacts_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A budget that ends after one path, which has no standard error."""
    law = Restitution(coefficient=0.5)
    scene = Scene(
        structure=Isolator(frequency_hz=10.0, zeta=0.1),
        impact_pairs=[ImpactPair(lower=-1e-3, upper=1e-3, law=law)],
        excitations=[WhiteNoise(intensity=1e-3)],
    )

    def after_one(self: Run, sampler: Any, *_: Any, **__: Any) -> Any:
        return self.until(sampler, 1)

    monkeypatch.setattr(Run, "to_accuracy", after_one)
    with pytest.raises(NotConverged, match="after one path; raise budget"):
        impacts(scene, budget=60.0)


def test_a_level_of_a_phase_has_the_limits_of_that_of_an_excitation() -> None:
    with pytest.raises(SceneError, match=r"level_db outside -200\.\.200, got 1e\+09"):
        Phase(name="road", duration=10.0, level_db=1e9)


def test_a_mount_far_above_its_record_is_screened() -> None:
    """A law of its motion: it follows the base, however stiff it is."""

    def density(f: np.ndarray) -> np.ndarray:
        return np.where((f >= 5.0) & (f <= 120.0), 1.0, 0.0)

    found = response_law(density, top=125.0, natural=1e4, width=2e3)
    zero, two = 115.0, (120.0**3 - 5.0**3) / 3.0
    assert found.crossing_rate == pytest.approx(math.sqrt(two / zero), rel=0.03)


def test_a_curve_of_clearances_needs_stops(tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[excitation]]\nkind = "psd"\nprofile = "mil-std-810h-truck-vertical-5hz"\n'
    )
    found = CliRunner().invoke(main, ["clearance", str(path)])
    assert found.exit_code == 2 and "the scene needs an impact_pair" in found.stderr
