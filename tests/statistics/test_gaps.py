"""Many gaps at once: their order and the bounds of their probabilities against counted windows of
motion that numpy alone makes, and what an answer says of them."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ImpactPair,
    Matrices,
    NotApplicable,
    Restitution,
    Scene,
    Sine,
    TabulatedNoise,
    WhiteNoise,
    reliability,
)
from stochvi.model.model import model_of
from stochvi.results.estimates import Estimate
from stochvi.scenes.phases import Phase
from stochvi.scenes.structures import Modes
from stochvi.statistics.crossings import first_crossings
from stochvi.statistics.reliability import gaps as many
from stochvi.statistics.reliability import risk
from stochvi.statistics.reliability.gaps import (
    FIRST,
    MANY,
    SHARES,
    Following,
    among,
    least,
    ranked,
)
from stochvi.testing import assert_agrees
from support.accuracies import quick_cases
from support.commands import Run
from support.known import to_toml

HARD = Restitution(coefficient=0.5)
BAND, DENSITY = (5.0, 100.0), 0.04 * 9.80665**2


class Plain(NamedTuple):
    """A structure of modes on a shaken base, and its gaps in standard deviations of their own."""

    frequency_hz: np.ndarray
    zeta: np.ndarray
    participation: np.ndarray
    shapes: np.ndarray  # (gaps, modes)
    std: np.ndarray
    upper: np.ndarray
    lower: np.ndarray

    def moved(self, frequency_hz: np.ndarray, gaps: Any = slice(None)) -> np.ndarray:
        """Gaps per unit of the acceleration of the base, (frequencies, gaps)."""
        w, w0 = 2.0 * np.pi * frequency_hz[:, None], 2.0 * np.pi * self.frequency_hz
        modal = -self.participation / (w0**2 - w**2 + 2j * self.zeta * w0 * w)
        return np.asarray(modal @ self.shapes[gaps].T)

    def scene(self) -> Scene:
        """The same as a scene."""
        names = [f"n{number}" for number in range(len(self.shapes))]
        stops = zip(self.std * self.upper, -self.std * self.lower, strict=True)
        return Scene(
            structure=Modes(
                frequency_hz=self.frequency_hz.tolist(), zeta=self.zeta.tolist(),
                participation=self.participation.tolist(),
                shapes={n: row.tolist() for n, row in zip(names, self.shapes, strict=True)},
            ),
            impact_pairs=[
                ImpactPair(
                    name=name.replace("n", "gap "), on=name, upper=upper, law=HARD,
                    lower=lower if math.isfinite(lower) else None,
                )
                for name, (upper, lower) in zip(names, stops, strict=True)
            ],
            excitations=[
                TabulatedNoise(
                    on="base", frequency_hz=[*BAND], density=[0.04, 0.04], unit="g2/Hz"
                )
            ],
        )  # fmt: skip


def plain(seed: int, modes: int, gaps: int) -> Plain:
    """A random structure: each gap moves in a few of the modes; some modes are hardly damped."""
    random = np.random.default_rng(seed)
    shapes = random.standard_normal((gaps, modes)) * (random.random((gaps, modes)) < 0.15)
    shapes[np.arange(gaps), random.integers(0, modes, gaps)] += 2.0
    upper = random.uniform(3.2, 6.0, gaps)
    found = Plain(
        np.sort(random.uniform(15.0, 80.0, modes)),
        np.exp(random.uniform(math.log(0.004), math.log(0.05), modes)),
        random.standard_normal(modes), shapes, np.ones(gaps), upper,
        np.where(random.random(gaps) < 0.4, 1.02 * upper, np.inf),
    )  # fmt: skip
    f = np.linspace(*BAND, 20001)
    variance = np.trapezoid(DENSITY * np.abs(found.moved(f)) ** 2, f, axis=0)
    return found._replace(std=np.sqrt(variance))


def windows(of: Plain, gaps: np.ndarray, mission: float, records: int, seed: int) -> np.ndarray:
    """Whether each gap closes in missions (gaps, missions) of long records of plain noise, with
    parabolas through the highest samples."""
    samples, rate, hits = 2**20, 1600.0, []
    f = np.arange(samples // 2 + 1) * rate / samples
    inside = np.flatnonzero((f >= BAND[0]) & (f <= BAND[1]))
    moved = of.moved(f[inside], gaps) / of.std[gaps]
    random, length = np.random.default_rng([7, seed]), int(mission * rate)
    count = samples // length
    for _ in range(records):
        noise = random.standard_normal(len(inside)) + 1j * random.standard_normal(len(inside))
        noise *= math.sqrt(DENSITY * rate / samples / 4.0)
        spectrum, rows = np.zeros(samples // 2 + 1, complex), []
        for gap, column in zip(gaps, moved.T, strict=True):
            spectrum[inside] = noise * column
            y = np.fft.irfft(spectrum, samples, norm="forward")
            hit = _highest(y) > of.upper[gap]
            if np.isfinite(of.lower[gap]):
                hit |= _highest(-y) > of.lower[gap]
            rows.append(hit[: count * length].reshape(count, length).any(axis=1))
        hits.append(np.array(rows))
    return np.concatenate(hits, axis=1)


def _highest(y: np.ndarray) -> np.ndarray:
    before, after = np.roll(y, 1), np.roll(y, -1)
    bend = np.maximum(2.0 * y - before - after, 1e-12)
    return np.where((y >= before) & (y >= after), y + (after - before) ** 2 / (8.0 * bend), y)


def _error(hits: np.ndarray, parts: int = 32) -> np.ndarray:
    """Standard errors of means over missions that follow each other, by means of parts."""
    count = hits.shape[-1] // parts * parts
    means = hits[..., :count].reshape(*hits.shape[:-1], parts, -1).mean(axis=-1)
    return np.asarray(means.std(axis=-1, ddof=1) / math.sqrt(parts))


FAR, NO_EVENT = 4.5, 3.0
"""Standard errors that are allowed, and missions that may hide where none was hit."""


def misplaced(order: list[int], hits: dict[int, np.ndarray]) -> list[tuple[int, int]]:
    """Gaps that an order puts before others although counting says otherwise beyond its errors."""
    found = []
    for place, one in enumerate(order[:FIRST]):
        for two in order[place + 1 :]:
            more = hits[two].astype(float) - hits[one]
            if more.mean() > FAR * _error(more) + NO_EVENT / len(more):
                found.append((one, two))
    return found


def outside(bounds: dict[int, tuple[float, float]], hits: dict[int, np.ndarray]) -> list[int]:
    """Gaps whose bounds counting contradicts beyond its errors."""
    return [
        gap
        for gap, (low, high) in bounds.items()
        for share in [hits[gap].mean()]
        for doubt in [FAR * _error(hits[gap]) + NO_EVENT / len(hits[gap])]
        if not low - doubt <= share <= high + doubt
    ]


def _number(name: str) -> int:
    return int(name.removeprefix("gap "))


@quick_cases(
    "seed, modes, gaps, records, factor",
    [(100, 12, 40, 2, 10.0), *((seed, 50, 300, 4, 2.5) for seed in range(20))], keep=[0],
)  # fmt: skip
@pytest.mark.slow
def test_the_first_ten_of_random_models_and_their_bounds_against_counted_missions(
    seed: int, modes: int, gaps: int, records: int, factor: float
) -> None:
    of, mission = plain(seed, modes, gaps), 1.0
    found, any_of_them = ranked(model_of(of.scene()), mission)
    order = [_number(name) for name in found]
    # Rice in the test: gaps beyond these are too seldom reached to be one of the first ten
    f = np.linspace(*BAND, 20001)
    density = np.abs(of.moved(f)) ** 2 * (2.0 * np.pi * f[:, None]) ** 2
    speed = np.sqrt(np.trapezoid(DENSITY * density, f, axis=0)) / of.std
    crossed = sum(
        speed / (2.0 * np.pi) * np.exp(-0.5 * u**2) * mission for u in (of.upper, of.lower)
    )
    looked = np.union1d(np.argsort(-crossed)[: 10 * records], order[:FIRST])
    hits = dict(zip(looked.tolist(), windows(of, looked, mission, records, seed), strict=True))
    tenth = sorted(hits, key=lambda gap: -hits[gap].mean())[FIRST - 1]
    others = np.delete(crossed, looked)
    assert not len(others) or others.max() < hits[tenth].mean()

    within = [gap for gap in order if gap in hits]
    assert within[:FIRST] == order[:FIRST]
    assert not misplaced(within, hits)
    bounds = {gap: (found[f"gap {gap}"].at_least, found[f"gap {gap}"].at_most) for gap in hits}
    assert not outside(bounds, hits)
    together = np.any([*hits.values()], axis=0)
    assert any_of_them.lower <= together.mean() + FAR * _error(together)
    assert any_of_them.upper >= together.mean() - FAR * _error(together)
    near = [found[f"gap {gap}"].probability / hits[gap].mean() for gap in order[:FIRST]]
    assert 0.85 < np.median(near) < 1.15
    # the same missions do notice an order by three sigma, and bounds that are too narrow
    by_sigma = sorted(hits, key=lambda gap: of.upper[gap] / of.std[gap] ** 0.5)
    assert misplaced(by_sigma, hits)
    assert outside({gap: (factor * low, high) for gap, (low, high) in bounds.items()}, hits)
    assert outside({gap: (low, high / factor) for gap, (low, high) in bounds.items()}, hits)


def two_masses(*pairs: ImpactPair, **more: Any) -> Scene:
    """Two equal oscillators that nothing couples, the first one shaken."""
    eye = np.eye(2)
    excitations = [WhiteNoise(intensity=0.2, on="x"), *more.pop("excitations", [])]
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=eye.tolist(), damping=(0.1 * eye).tolist(),
            stiffness=eye.tolist(),
        ),
        impact_pairs=pairs, excitations=excitations, **more,
    )  # fmt: skip


def test_a_rate_is_that_of_first_crossings_and_twins_count_once() -> None:
    stops = [
        ImpactPair(name=name, on="x", lower=-3.0, upper=3.0, law=HARD) for name in ("left", "right")
    ]
    mission = 60.0
    seen = [
        first_crossings(two_masses(stops[0]), rel_error=0.02, seed=seed).probability(mission)[0]
        for seed in range(24)
    ]
    exact = float(np.mean([each.value for each in seen]))  # known to 0.5 %
    found, both = ranked(model_of(two_masses(*stops)), mission)
    for each in found.values():
        # the chain of crossings is near, and Rice's formula alone is not
        assert each.probability == pytest.approx(exact, rel=0.06)
        assert each.at_least < exact < each.at_most
        assert each.at_most > 1.5 * exact
    assert both.estimate.value == pytest.approx(exact, rel=0.06)
    # of two stops one after the other is reached: one alone has more than half of their risk
    upper = ImpactPair(name="up", on="x", upper=3.0, law=HARD)
    (single,) = ranked(model_of(two_masses(upper)), mission)[0].values()
    assert 0.5 < single.probability / found["left"].probability < 0.85


def test_crossings_that_follow_are_those_of_two_sampled_normal_motions() -> None:
    r, rate, bend, w, own, u, v = 0.6, -0.35, -0.5, 1.0, 1.3, 0.8, 0.5
    places, cross = np.array([[1.0, r], [r, 1.0]]), np.array([[0.0, rate], [-rate, 0.0]])
    speeds = np.array([[w**2, -bend], [-bend, own**2]])
    given = cross @ np.linalg.inv(places)
    mean, law = given @ [u, v], speeds - given @ cross.T
    dx, dy = np.random.default_rng(1).multivariate_normal(mean, law, 400_000).T
    both = np.maximum(dx, 0.0) * np.maximum(dy, 0.0)
    density = math.exp(-0.5 * np.array([u, v]) @ np.linalg.solve(places, [u, v]))
    density /= 2.0 * np.pi * math.sqrt(np.linalg.det(places))
    crossed = w / (2.0 * np.pi) * math.exp(-0.5 * u**2)
    sampled, error = density / crossed * np.array([both.mean(), both.std() / math.sqrt(len(both))])
    known = Following.of(u, v, w, own, np.array([[r], [rate], [bend]]))
    rates = SHARES @ known.rate
    assert abs(sampled - rates[0]) < 4.5 * error + 1e-3 * sampled
    assert abs(sampled - 1.05 * rates[0]) > 4.5 * error + 1e-3 * sampled
    # by slope there are as many, at whatever slopes they come
    assert known.by_slope(np.ones(1)).sum(axis=1) == pytest.approx(known.rate[:, 0])


def test_a_certain_contact_is_told_at_once() -> None:
    of = plain(3, 5, 5)
    near = of._replace(upper=0.4 * of.upper)
    found = reliability(near.scene(), mission=3600.0)
    assert found.cost.paths == found.cost.steps == 0
    assert found.chances["hit"].lower > 0.99
    assert found.hits is None
    assert "over 99" in found.summary()
    assert set(found.gaps) == {f"gap {number}" for number in range(5)}
    assert found["gap 2"].crossings > 1000.0
    assert found["gap 2.probability"] > 0.99
    # a pair that is pressed onto its stop is refused as before
    pressed = near._replace(upper=np.array([-0.1, 1.0, 1.0, 1.0, 1.0]), lower=np.full(5, np.inf))
    with pytest.raises(NotApplicable, match="pressed onto"):
        reliability(pressed.scene(), mission=3600.0)


@pytest.mark.slow
def test_the_first_of_many_are_simulated_where_that_is_asked_for() -> None:
    of = plain(5, 6, MANY + 4)
    # so near that the first gap closes in a third of the missions
    scene = of._replace(upper=0.35 * of.upper, lower=0.35 * of.lower, zeta=10.0 * of.zeta).scene()
    at_once = reliability(scene, mission=20.0)
    assert at_once.cost.paths == 0
    assert len(at_once.gaps) == MANY + 4
    found = reliability(scene, mission=20.0, way="first crossings", rel_error=0.3, seed=1)
    assert list(found.gaps) == list(at_once.gaps)
    assert list(found.gaps)[:FIRST] == sorted(found.pairs, key=list(found.gaps).index)
    hit, bounds = found.chances["hit"], at_once.chances["hit"]
    assert bounds.lower < hit.estimate.value + 4.5 * hit.estimate.standard_error
    assert hit.estimate.value - 4.5 * hit.estimate.standard_error < bounds.upper
    # what others may add is in the bias and in the upper end, however seldom the ten are hit
    others = sum(gap.at_most for name, gap in found.gaps.items() if name not in found.pairs)
    assert others > 0.0
    plainly = hit.estimate.value + 1e-12
    assert hit.estimate.bias is not None and hit.estimate.bias >= min(others, 1.0 - plainly)
    seldom = replace(hit, upper=0.1, estimate=Estimate(value=0.0, bias=0.0, upper_95=0.1))
    more = among(seldom, found.gaps, [*found.pairs])
    assert more.upper == more.estimate.upper_95 == pytest.approx(min(0.1 + others, 1.0))
    name = next(iter(found.gaps))
    alone = reliability(scene, mission=20.0, pair=name, rel_error=0.1, seed=1).chances["hit"]
    risk = found.gaps[name]
    assert_agrees(alone.estimate, risk.probability)
    with pytest.raises(AssertionError):  # Rice's crossings alone
        assert_agrees(alone.estimate, risk.at_most)


@pytest.mark.slow
def test_gaps_of_phases_are_those_of_all_together() -> None:
    scene = plain(5, 6, MANY + 4).scene()
    (noise,) = scene.excitations
    phases = [
        Phase(name=name, duration=duration, excitations=[noise.replace(level_db=level)])
        for name, duration, level in (("road", 20.0, -2.0), ("air", 200.0, -4.0))
    ]
    found = reliability(scene.replace(excitations=[], phases=phases))
    parts = [
        reliability(scene.replace(excitations=phase.own_excitations), mission=phase.duration)
        for phase in phases
    ]
    for name, gap in found.gaps.items():
        for key in ("probability", "at_least", "at_most"):
            kept = math.prod(1.0 - getattr(part.gaps[name], key) for part in parts)
            assert getattr(gap, key) == pytest.approx(1.0 - kept, rel=1e-9, abs=1e-15)
    likely = [gap.probability for gap in found.gaps.values()]
    assert likely == sorted(likely, reverse=True)
    hit, of_parts = found.chances["hit"], [part.chances["hit"] for part in parts]
    for end in ("lower", "upper"):
        kept = math.prod(1.0 - getattr(part, end) for part in of_parts)
        assert getattr(hit, end) == pytest.approx(1.0 - kept, rel=1e-6)


def test_gaps_that_cannot_be_simulated_keep_their_ranks_and_bounds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A structure whose times lie too far apart for records, which are long to be refused."""

    def refused(*_: Any) -> None:
        raise NotApplicable("first_crossings", ["a record of 10 gaps needs more samples"])

    monkeypatch.setattr(risk, "_simulated", refused)
    monkeypatch.setattr(many, "MOST_SAMPLES", 100)
    scene = plain(5, 6, MANY + 4).scene()
    asked = reliability(scene, mission=20.0, way="first crossings")
    assert len(asked.gaps) == MANY + 4 and asked.cost.paths == 0
    assert any("first gaps are not simulated" in each for each in asked.warnings)
    # nothing is known of clusters then: at least the probability to start beyond the stop
    assert all(2.0 * gap.at_least < gap.probability for gap in asked.gaps.values())
    assert all(gap.probability <= gap.at_most for gap in asked.gaps.values())
    with pytest.raises(NotApplicable, match="more samples"):
        reliability(scene, mission=20.0, impact_speed=0.1)


@pytest.mark.slow
def test_sines_beside_the_noise_leave_the_bounds_that_hold_for_them() -> None:
    pairs = [
        ImpactPair(name=f"at {level}", on="x", upper=0.5 * level, law=HARD)
        for level in range(5, 5 + MANY + 1)
    ]
    sine = Sine(amplitude=0.3, frequency_hz=0.05, on="x")
    found = reliability(two_masses(*pairs, excitations=[sine]), mission=50.0)
    assert list(found.gaps) == [pair.name for pair in pairs]
    assert all(gap.at_least <= gap.probability <= gap.at_most for gap in found.gaps.values())
    quiet = reliability(two_masses(*pairs), mission=50.0).gaps
    assert all(found.gaps[name].crossings > gap.crossings for name, gap in quiet.items())


def test_a_bound_holds_where_counts_are_known() -> None:
    # N is 0 or 3: P(N > 0) is its mean over 3
    assert least(np.array([[9.0 * 0.2]]), np.array([0.6])) == pytest.approx(0.2)
    assert least(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([1.0, 0.0])) == 1.0


@pytest.mark.slow
def test_files_and_the_console_of_many_gaps(stochvi: Run, tmp_path: Path) -> None:
    scene = plain(5, 6, MANY + 4).scene()
    (tmp_path / "many.toml").write_text(to_toml(scene.document()))
    out = tmp_path / "out"
    told = stochvi(
        "reliability", str(tmp_path / "many.toml"), "--mission", "20s", "--out", str(out)
    )
    assert told.code == 0
    listed = [line.split("  ")[0] for line in told.out.splitlines() if line.startswith("gap ")]
    rows = list(csv.DictReader((out / "gaps.csv").read_text().splitlines()))
    table = reliability(scene, mission=20.0).gap_table()
    assert table.to_csv(index=False) == pd.read_csv(out / "gaps.csv").to_csv(index=False)
    assert [row["gap"] for row in rows[:FIRST]] == listed[-FIRST:]
    assert len(rows) == MANY + 4
    assert {"clearance_m", "displacement_std_m", "at_least", "at_most"} <= {*rows[0]}
    document = json.loads((out / "reliability.json").read_text())
    assert [*document["gaps"]] == [row["gap"] for row in rows]
    assert document["gaps"][listed[-1]]["probability"] == float(rows[FIRST - 1]["probability"])
    assert (out / "gaps.png").stat().st_size > 10_000
    assert "Gaps by the probability" in (out / "report.html").read_text()
