"""The risk of a production: against closed forms, and brute force unit by unit."""

from __future__ import annotations

import math
from io import StringIO
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rich.console import Console
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import norm, qmc, t

from stochvi import (
    ConstantLoad,
    Elastic,
    ImpactPair,
    Isolator,
    Matrices,
    NotApplicable,
    Oscillator,
    Restitution,
    Scene,
    TabulatedNoise,
    Viscoelastic,
    WhiteNoise,
    exact,
    load_scene,
    mean_over_units,
)
from stochvi.cli.options import tolerances_of
from stochvi.isolators import Spread, production, production_risk, size
from stochvi.isolators.production_risk import Start, Units
from stochvi.isolators.sizing import search
from stochvi.isolators.sizing.risk_curve import chance_of_stops
from stochvi.isolators.tolerances import Region, Tolerances
from stochvi.model.model import model_of
from stochvi.results.deadline import NEVER
from stochvi.results.estimates import spoken_percent
from stochvi.scenes.datasets import shipped_scene
from stochvi.statistics.crossings import own_distances
from stochvi.sweeps import sweep
from stochvi.views.isolator_tables import production_section, production_told
from stochvi.views.pages import print_told
from support import judges
from support.accuracies import quick_cases, run_of
from support.refusals import refusals

WHITE = [WhiteNoise(density=0.01, unit="g2/Hz")]
LAW = Restitution(coefficient=0.5)
ONE_STOP = Scene(
    structure=Isolator(frequency_hz=10.0, zeta=0.05),
    impact_pairs=[ImpactPair(upper=0.01, law=LAW)],
    excitations=WHITE,
)
MISSION = 3600.0


def units_of(scene: Scene, spreads: dict[str, Spread], place: float) -> Units:
    stops = np.array([[math.inf], [place]])
    mean = Region(scene, Tolerances()).nominal.mean
    found = Units(scene=scene, spreads=spreads, mean=mean, stops=stops)
    found.solve(NEVER)
    return found


def test_the_mean_of_rices_rate_over_gaussian_clearances_is_closed() -> None:
    sigma = float(Region(ONE_STOP, Tolerances()).nominal.sigma[0])
    place, std = 4.0 * sigma, 0.3 * sigma
    units = units_of(ONE_STOP, {"clearance": Spread(std=std)}, place)
    points = (np.arange(200_000)[:, None] + 0.5) / 200_000
    gaps = units.gaps(units.drawn(points))
    # E exp(-(c + e)^2 / (2 s^2)) of a Gaussian e
    both = sigma**2 + std**2
    exact = gaps.rate[0, 0] * sigma / math.sqrt(both) * math.exp(-0.5 * place**2 / both)
    assert gaps.rice(units.stops).mean() == pytest.approx(exact, rel=1e-4)
    # the control: a unit as stated has far less
    assert gaps.rate[0, 0] * math.exp(-0.5 * (place / sigma) ** 2) < 0.6 * exact


def test_gaps_of_units_are_those_of_changed_scenes() -> None:
    spreads = {
        "frequency": Spread(std=0.05), "damping": Spread(half_width=0.4), "level": Spread(std=1.0),
        "clearance": Spread(std=1e-4),
    }  # fmt: skip
    hung = ONE_STOP.replace(excitations=[*WHITE, ConstantLoad(acceleration=-9.81)])
    units = units_of(hung, spreads, 0.01)
    amounts = units.drawn(np.random.default_rng(1).random((5, 4)))
    gaps = units.gaps(amounts)
    nominal = Region(hung, Tolerances()).nominal
    for row, sigma, rate, farther in zip(amounts, *gaps, strict=True):
        changed = Region(units.unit(row), Tolerances()).nominal
        # interpolated between mounts a quarter of a half width apart
        assert sigma == pytest.approx(changed.sigma, rel=2e-4)
        assert rate == pytest.approx(changed.rate, rel=2e-4)
        # a mount that hangs lower is farther from its upper stop; its own error is added
        moved = float(nominal.mean[0] - changed.mean[0])
        assert float(farther[1, 0]) == pytest.approx(moved + row[3], rel=1e-3)
        assert float(farther[0, 0]) == pytest.approx(-moved, rel=1e-3)


@pytest.mark.slow
def test_shares_of_variance_and_units_above_the_target_are_closed() -> None:
    std_db, std = 0.6, 6e-4
    spreads = {"level": Spread(std=std_db), "clearance": Spread(std=std)}
    found = production(
        ONE_STOP, spreads, probability=0.01, mission=MISSION, rel_error=0.1, seed=2, threads=1
    )
    assert judges.columns_without_judge(found) == []
    place = found.stated["stops"]
    # a unit needs c 10^(level / 20) - e, c the clearance that it needs at the stated level
    log_std = std_db * math.log(10.0) / 20.0
    by_level = place**2 * math.exp(log_std**2) * math.expm1(log_std**2)
    for row, share in zip(found.tolerances.to_dict("records"), (by_level, std**2), strict=True):
        wanted = share / (by_level + std**2)
        assert row["first_order"] == pytest.approx(wanted, abs=4.5 * row["first_order_error"])
        assert row["total"] == pytest.approx(wanted, abs=4.5 * row["total_error"])
        assert row["total_error"] < 0.05
    # with the clearance alone, a unit is above the target where e is below what is kept in reserve
    alone = production(
        ONE_STOP, {"clearance": Spread(std=std)}, probability=0.01, mission=MISSION, rel_error=0.1,
        seed=2, threads=1,
    )  # fmt: skip
    reserve = alone.clearances["stops"].value - alone.stated["stops"]
    assert alone.share_above is not None
    # the correction is that of the mean, and moves the reserve by its own error
    error = 4.5 * alone.share_above.standard_error + 0.1 * norm.pdf(reserve / std)
    assert alone.share_above.value == pytest.approx(norm.cdf(-reserve / std), abs=error)
    # E exp(-(c + e)^2 / (2 s^2)) of the production is exp(-c^2 / (2 s^2)) of a unit as stated
    sigma = float(Region(ONE_STOP, Tolerances()).nominal.sigma[0])
    both = sigma**2 + std**2
    level = (alone.stated["stops"] / sigma) ** 2 + math.log(sigma**2 / both)
    clearance = alone.clearances["stops"]
    half = clearance.upper - clearance.value
    assert clearance.value == pytest.approx(math.sqrt(both * level), abs=4.5 / 1.96 * half)
    assert reserve > 10.0 * half
    # and so is what the tolerance costs, with the mean correction of the production for both
    cost = float(alone.tolerances["clearance_cost"][0])
    kept = 0.01 / alone.correction.value
    hits = -math.log1p(-kept) * math.exp(0.5 * ((clearance.value - cost) / sigma) ** 2)

    def excess(place: float) -> float:
        def part(e: float) -> float:
            expected = hits * math.exp(-0.5 * ((place + e) / sigma) ** 2)
            return float(-math.expm1(-expected) * norm.pdf(e, scale=std))

        return quad(part, -8.0 * std, 8.0 * std, epsabs=1e-10)[0] - kept

    needed = brentq(excess, clearance.value - cost, clearance.value + cost)
    # the drawn units know the mean risk to half of the accuracy that was asked for
    known = 0.05 * sigma**2 / clearance.value
    assert clearance.value == pytest.approx(needed, abs=known)
    assert cost > 8.0 * known
    shares = alone.units["share_of_units"].to_numpy()
    # a unit with the quantile of e has its own need at the stated place less e
    needs = clearance.value - cost - std * norm.ppf(1.0 - shares)
    quantile = np.sqrt(
        shares * (1.0 - shares) / (2 * production_risk.SEQUENCES * production_risk.POINTS)
    )
    error = 4.5 * std * quantile / norm.pdf(norm.ppf(shares)) + known
    assert np.all(np.abs(alone.units["clearance"].to_numpy() - needs) < error)
    assert np.median(error) < 0.2 * std


BOX = load_scene(shipped_scene("rigid-box"))
TRUCK = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")


def two_masses() -> Scene:
    stops = {"lower": -0.02, "upper": 0.02, "law": LAW}
    return Scene(
        structure=Matrices(
            coordinates=("x", "z"), mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[3.0, -1.0], [-1.0, 3.0]], stiffness=[[4000.0, -500.0], [-500.0, 6000.0]],
        ),
        impact_pairs=[
            ImpactPair(name="one", on="x", **stops), ImpactPair(name="two", on="z", **stops)
        ],
        excitations=[WhiteNoise(intensity=0.3, on="x"), WhiteNoise(intensity=0.3, on="z")],
    )  # fmt: skip


def mount(frequency: float, zeta: float, **more: object) -> Isolator:
    return Isolator(frequency_hz=frequency, zeta=zeta, **more)  # type: ignore[arg-type]


def between(structure: Isolator, noise: object = WHITE[0]) -> Scene:
    return Scene(
        structure=structure, impact_pairs=[ImpactPair(lower=-1.0, upper=1.0, law=LAW)],
        excitations=[noise],
    )  # fmt: skip


FREQUENCY, DAMPING, LEVEL = Spread(std=0.04), Spread(half_width=0.3), Spread(std=0.4)
SCENES: list[tuple[Scene, dict[str, Spread]]] = [
    (between(mount(10.0, 0.05)), {"frequency": FREQUENCY, "clearance": Spread(std=3e-4)}),
    (two_masses(), {"frequency": Spread(std=0.02), "clearance": Spread(half_width=5e-4)}),
    (between(mount(10.0, 0.05)), {"damping": DAMPING}),
    (between(mount(12.0, 0.1), TRUCK), {"frequency": Spread(half_width=0.1), "damping": DAMPING}),
    (between(mount(12.0, 0.1, gravity=True), TRUCK), {"frequency": FREQUENCY, "level": LEVEL}),
    (between(mount(25.0, 0.02)), {"frequency": FREQUENCY, "damping": Spread(std=0.15)}),
    (ONE_STOP, {"damping": DAMPING, "clearance": Spread(half_width=4e-4)}),
    (between(mount(6.0, 0.15)), {"frequency": FREQUENCY, "level": LEVEL, "damping": DAMPING}),
    (two_masses(), {"damping": Spread(std=0.2), "level": LEVEL}),
    (BOX, {"frequency": Spread(std=0.03), "damping": Spread(std=0.1)}),
    (BOX, {"centre": Spread(std=3e-3), "clearance": Spread(std=1e-4)}),
    (between(mount(8.0, 0.3)), {"frequency": Spread(std=0.03, mean=0.05), "level": LEVEL}),
]


SEQUENCES = 8
"""Sequences of Sobol' points, each scrambled on its own: their scatter is the error of the mean."""


@pytest.mark.slow
@quick_cases("scene, spreads", SCENES, keep=(0,))
def test_the_mean_over_units_is_that_of_each_unit_calculated(
    scene: Scene, spreads: dict[str, Spread], request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Every unit by first crossings of its own, with no scaling from the scene as stated.

    Units of evenly spread points and one seed for all of them: the mean of 256 is known to 3 to
    12 %, where 200 that were drawn at random left 20 to 30 %. The control is a unit as stated,
    between the same stops: its probability must lie beyond all errors.
    """
    quick = request.node.get_closest_marker("verify") is None
    each = 4 if quick else 32
    if quick:
        monkeypatch.setattr(production_risk, "SIMULATED", 4)
    found = production(
        scene, spreads, probability=0.02, mission=600.0, rel_error=0.1, seed=3, threads=1
    )
    assert found.probability.value == pytest.approx(0.02, rel=1e-6)
    own = np.array(own_distances(model_of(scene)))
    places = [found.clearances[pair.name].value for pair in scene.impact_pairs]
    stops = np.where(np.isfinite(own), places, math.inf)
    mean = Region(scene, Tolerances()).nominal.mean
    units = Units(scene=scene, spreads=spreads, mean=mean, stops=stops)
    units.solve(NEVER)
    means = []
    for sequence in range(SEQUENCES):
        points = qmc.Sobol(len(units.columns), rng=np.random.default_rng([17, sequence]))
        amounts = units.drawn(points.random(each))
        farther = units.gaps(amounts).farther
        with run_of(0.1, seed=100) as run:
            chances = [
                chance_of_stops(units.unit(row), stops + far, 600.0, run).value
                for row, far in zip(amounts, farther, strict=True)
            ]
        means.append(float(np.mean(chances)))
    error = math.hypot(
        float(np.std(means, ddof=1)) / math.sqrt(SEQUENCES), found.probability.standard_error
    )
    brute, bias = float(np.mean(means)), found.probability.bias or 0.0
    with run_of(0.1, seed=100) as run:
        stated = chance_of_stops(scene, stops, 600.0, run).value
    print(f"{brute:.5f}({error:.5f}) {(brute - 0.02) / error:.2f} as stated {stated:.5f}")
    # Student's, of eight sequences
    widest = float(t.ppf(norm.cdf(4.5), SEQUENCES - 1)) if quick else 4.5
    assert abs(brute - 0.02) < widest * error + bias
    if not quick:
        assert abs(brute - stated) > 4.5 * error + bias


def test_what_is_printed_drawn_and_written_is_the_answer() -> None:
    spreads = {"frequency": Spread(std=0.02), "clearance": Spread(half_width=2e-4, mean=1e-4)}
    found = production(ONE_STOP, spreads, mission=60.0, rel_error=0.3, threads=1)
    document = found.to_dict()
    assert document["method"] == "production" and document["target"] is None
    assert document["spreads"]["clearance"] == {"std": None, "half_width": 2e-4, "mean": 1e-4}
    assert document["clearances"]["stops"]["value"] == pytest.approx(0.01)
    text = StringIO()
    print_told(Console(file=text, width=200), production_told(found))
    told = text.getvalue()
    assert "uniform, ± 0.2 mm, mean +0.1 mm" in told and found.dearest() in told
    assert spoken_percent(found.probability.value) in found.summary()
    ax = found.plot()
    drawn = ax.get_lines()[0].get_xdata()
    assert set(drawn) <= set(found.units["probability"])
    plt.close("all")
    assert production_section(None).empty and not production_section(found).empty


def test_a_tolerance_without_a_distribution_costs_clearance_as_well() -> None:
    """Where the level alone may be off, the clearance grows as the rms does: by 12.2 % for 1 dB.

    The corrections of single units are interpolated over the clearance that each needs: they move
    a little with it.
    """
    spreads = {"frequency": Spread(std=0.05), "damping": Spread(std=0.1)}
    found = production(
        ONE_STOP, spreads, probability=0.01, mission=60.0,
        tolerances=Tolerances(level_db=1.0), rel_error=0.3, threads=1,
    )  # fmt: skip
    costs = dict(
        zip(found.tolerances["tolerance"], found.tolerances["clearance_cost"], strict=True)
    )
    needed = next(iter(found.clearances.values())).value
    assert costs["level ± 1 dB"] == pytest.approx(needed * (1.0 - 10.0**-0.05), rel=5e-3)
    assert found.dearest().startswith("level ± 1 dB costs the most clearance: ")
    assert math.isnan(found.tolerances["total"].iloc[-1])
    text = StringIO()
    print_told(Console(file=text, width=200), production_told(found))
    assert "level ± 1 dB" in text.getvalue()
    plt.close(found.plot().figure)


def test_tolerances_of_the_command_line() -> None:
    scene = Scene(structure=Isolator(frequency_hz=10.0, zeta=0.05, frequency_tolerance=0.1),
                  excitations=WHITE)  # fmt: skip
    limits, spreads = tolerances_of(
        scene, "usual, frequency=normal:3%:+1%, clearance=uniform:0.1mm"
    )
    assert spreads == {
        "frequency": Spread(std=0.03, mean=0.01), "clearance": Spread(half_width=1e-4)
    }  # fmt: skip
    # a quantity with a distribution has no limit besides
    assert limits == Tolerances(damping=0.3, level_db=3.0, stiffness=0.2)
    assert tolerances_of(scene, None) == (None, {})
    assert tolerances_of(scene, "level=2dB") == (Tolerances(frequency=0.1, level_db=2.0), {})


test_tolerances_that_nobody_understands_are_refused = refusals(
    lambda text: tolerances_of(ONE_STOP, text),
    ("frequency=norm:3%", "--tolerances must be usual, or"),
    ("level=normal:1dB:0dB:0dB", "got 'level=normal:1dB:0dB:0dB'"),
    ("clearance=0.1mm", "the tolerance of clearance must be a distribution"),
    error=ValueError,
)


def test_spreads_that_a_scene_does_not_have_are_refused() -> None:
    with pytest.raises(ValueError, match="exactly one of std and half_width"):
        Spread()
    with pytest.raises(ValueError, match="spreads must be of frequency"):
        production(ONE_STOP, {"mass": Spread(std=0.1)}, probability=0.01)
    with pytest.raises(ValueError, match="must stay above -100 %, got -120 %"):
        production(ONE_STOP, {"damping": Spread(half_width=1.2)}, probability=0.01)
    with pytest.raises(ValueError, match="rigid-body"):
        production(ONE_STOP, {"centre": Spread(std=1e-3)}, probability=0.01)
    with pytest.raises(NotApplicable, match="probability of any impact"):
        size(ONE_STOP, rate=0.1, spreads={"clearance": Spread(std=1e-4)})
    with pytest.raises(ValueError, match="common must name impact pairs"):
        size(ONE_STOP, probability=0.01, common=["other"])


@pytest.mark.verify
def test_pairs_with_one_clearance_in_common_keep_the_target(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def not_counted(*_: object) -> None:
        raise NotApplicable("impacts", ["impacts are not counted in this test"])

    monkeypatch.setattr(search, "count_impacts", not_counted)
    scene, asked = two_masses(), {"probability": 0.05, "mission": 60.0, "threads": 1}
    each = size(scene, rel_error=0.2, **asked)
    both = size(scene, rel_error=0.2, common=["one", "two"], **asked)
    place = both.clearances["one"]
    assert both.clearances["two"] == place and both.probability.value == pytest.approx(0.05)
    assert min(c.value for c in each.clearances.values()) < place.value
    assert place.value < max(c.value for c in each.clearances.values())
    with run_of(0.05, seed=11) as run:
        chance = chance_of_stops(scene, np.full((2, 2), place.value), 60.0, run)
    error = math.hypot(chance.standard_error, 0.2 * 0.05)
    assert abs(chance.value - 0.05) < 4.5 * error + (chance.bias or 0.0)


def own_place(spreads: dict[str, Spread], target: float) -> float:
    """Where a mount of 10 Hz and damping 0.05 under white noise keeps a target, by plain sums over
    its units: sigma^2 is as 1 / (damping frequency^3), and Rice's rate the frequency."""
    sigma = float(Region(ONE_STOP, Tolerances()).nominal.sigma[0])
    grids = {name: np.zeros(1) for name in ("frequency", "damping", "level", "clearance")}
    density = {name: np.ones(1) for name in grids}
    for name, spread in spreads.items():
        if spread.half_width is not None:
            places = (2.0 * np.arange(1000) + 1.0) / 1000.0 - 1.0
            grids[name] = spread.mean + spread.half_width * places
            density[name] = np.ones(1000)
        else:
            assert spread.std is not None
            grids[name] = spread.mean + spread.std * np.linspace(-8.0, 8.0, 1601)
            density[name] = norm.pdf(np.linspace(-8.0, 8.0, 1601))
        if name in ("damping", "frequency"):  # none at or below 0
            density[name] = np.where(grids[name] > -1.0, density[name], 0.0)
            grids[name] = np.maximum(grids[name], 1e-6 - 1.0)
    f, z, level, off = np.meshgrid(*grids.values(), indexing="ij", sparse=True)
    part = np.einsum("i,j,k,l->ijkl", *[each / each.sum() for each in density.values()])
    rms = sigma * 10.0 ** (level / 20.0) / np.sqrt((1.0 + z) * (1.0 + f) ** 3)
    rate = 10.0 * (1.0 + f) * MISSION

    def excess(place: float) -> float:
        reach = np.maximum(place + off, 0.0) / rms
        mean = float(np.sum(part * -np.expm1(-rate * np.exp(-0.5 * reach**2))))
        return math.log(max(mean, 1e-300) / target)

    return float(brentq(excess, sigma, 100.0 * sigma))


RARE: list[tuple[dict[str, Spread], tuple[float, ...]]] = [
    ({"damping": Spread(std=0.25)}, (0.1, 1e-2, 1e-3, 1e-4)),
    ({"damping": Spread(std=0.1), "frequency": Spread(std=0.05)}, (0.1, 1e-2, 1e-4, 1e-6)),
    ({"level": Spread(std=2.0)}, (1e-2, 1e-4, 1e-6)),
    ({"damping": Spread(half_width=0.9), "clearance": Spread(std=1e-3)}, (1e-2, 1e-6)),
    ({"frequency": Spread(half_width=0.2), "level": Spread(half_width=3.0)}, (1e-2, 1e-6)),
]


@quick_cases("spreads, targets", RARE, keep=(0,))
def test_rare_means_are_those_of_all_units(
    spreads: dict[str, Spread], targets: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One or two of 4096 even units carry a mean of 1e-4; as many more are drawn where the risk
    is."""
    misses = 0
    for target in targets:
        sigma = float(Region(ONE_STOP, Tolerances()).nominal.sigma[0])
        stated = sigma * math.sqrt(2.0 * math.log(-10.0 * MISSION / math.log1p(-target)))
        stops = np.array([[math.inf], [stated]])
        own = own_place(spreads, target)
        for carried in (production_risk.CARRIED, 0.0):  # the control draws even units alone
            monkeypatch.setattr(production_risk, "CARRIED", carried)
            with run_of(0.1, seed=1) as run:
                job = production_risk._Job(
                    start=Start(
                        scene=ONE_STOP, mission=MISSION, stops=stops, chance=target, target=target,
                        sized=(0,),
                    ),
                    spreads=spreads, tolerances=Tolerances(), run=run,
                )  # fmt: skip
                job.quadrature()
            place = float(job.largest(job.placed(1.0)))
            # d ln P / d place = -place / rms of the units that are hit, at most twice the stated
            # the rms is interpolated to 2e-4, and own sums are good to 0.002
            bias = 0.002 + 4e-4 * math.log(10.0 * MISSION / target)
            error = 4.5 * job._relative(job.placed(1.0)) + bias
            away = abs(place - own) * own / (2.0 * sigma) ** 2
            if carried:
                assert away < error, (spreads, target, place, own)
                assert error < 0.1
            else:
                misses += away > 4.5 * 0.05  # half of what was asked for
    assert misses or spreads != RARE[0][0]


@pytest.mark.slow
def test_each_unit_has_the_correction_of_its_own_motion() -> None:
    """Quantiles of what units need, between light and heavy damping, by first crossings of such a
    unit; impacts of light ones come in clusters, and their factor is 3 times less."""
    spreads = {"damping": Spread(std=0.25)}
    found = production(ONE_STOP, spreads, probability=1e-4, rel_error=0.1, seed=2)
    assert "truncated at 0" in found.summary()
    units = units_of(ONE_STOP, spreads, 1.0)
    for share in (0.05, 0.5, 0.95):
        place = float(found.units.set_index("share_of_units")["clearance"][share])
        amount = units.drawn(np.array([[1.0 - share]]))[0]
        stops = np.array([[math.inf], [place]])
        with run_of(0.05, seed=9) as run:
            chance = chance_of_stops(units.unit(amount), stops, MISSION, run)
        # a probe is known to 0.2, and the stated scene to 0.1
        error = 4.5 * math.hypot(chance.standard_error / 1e-4, 0.2, 0.1)
        assert abs(math.log(chance.value / 1e-4)) < error, share
        # the control: the factor of the units that carry the mean
        light = float(found.simulated["probability"].sum() / found.simulated["linear"].sum())
        assert 0.5 < light < 1.1


# ------------------------------------------------------------------------------
# Means over units of any method's answer: against integrals, and brute force over many units.
# ------------------------------------------------------------------------------


RATE = "stops.collision_rate"


def between_of_unit_means(law: Any, lower: float | None = -1.0, upper: float | None = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=lower, upper=upper, law=law)],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def of(table: Any, quantity: str = RATE) -> dict[str, float]:
    found: dict[str, float] = table.set_index("quantity").loc[quantity].to_dict()
    return found


def test_the_mean_over_gaussian_clearances_is_an_integral() -> None:
    scene, std = between_of_unit_means(Restitution(coefficient=1.0), lower=None), 0.2

    def rate(off: float) -> float:
        pair = scene.impact_pairs[0].model_copy(update={"upper": 1.0 + off})
        response = exact(scene.model_copy(update={"impact_pairs": (pair,)}))
        found: float = response.impact_pairs["stops"].collision_rate.value  # type: ignore[union-attr]
        return found

    moments = [
        quad(lambda x, k=k: rate(std * x) ** k * norm.pdf(x), -8.0, 8.0, epsrel=1e-8)[0]
        for k in (1, 2)
    ]
    found = of(mean_over_units(scene, {"clearance": Spread(std=std)}, method="exact", nodes=7))
    assert found["mean"] == pytest.approx(moments[0], rel=1e-6)
    between_units = math.sqrt(moments[1] - moments[0] ** 2)
    assert found["std_between_units"] == pytest.approx(between_units, rel=1e-4)
    # the control: the unit as stated has another rate
    assert abs(rate(0.0) - moments[0]) > 1e-3 * moments[0]


def test_what_few_nodes_leave_out_of_a_rare_mean_is_its_bias() -> None:
    """A stop at 4 rms displacements, which are 1 m, that is off by up to 0.8 of them between units:
    an elastic stop at u is hit exp(-u^2 / 2) / (2 pi Phi(u)) times a second."""
    place = 4.0
    scene = between_of_unit_means(Restitution(coefficient=1.0), lower=None, upper=place)
    for std, nodes, fine in ((0.8, 3, False), (0.8, 5, False), (0.8, 15, True), (0.1, 5, True)):

        def part(x: float, std: float = std) -> float:
            u = place + std * x
            return float(math.exp(-0.5 * u**2) / (2.0 * math.pi * norm.cdf(u)) * norm.pdf(x))

        own = quad(part, -8.0, 8.0, epsrel=1e-9)[0]
        spreads = {"clearance": Spread(std=std)}
        found = of(mean_over_units(scene, spreads, method="exact", nodes=nodes))
        assert abs(found["mean"] - own) < found["bias"] + 1e-6 * own, (std, nodes)
        assert (found["bias"] < 0.02 * own) == fine, (std, nodes)


def test_statistical_errors_are_not_taken_for_differences_between_units() -> None:
    scene = between_of_unit_means(Restitution(coefficient=1.0))
    spreads = {"damping": Spread(half_width=0.3)}
    # fewer paths than an answer would take: the errors are large beside what differs
    found = of(
        mean_over_units(
            scene, spreads, nodes=3, paths=64, duration=100.0, seed=5, threads=1
        )
    )  # fmt: skip
    truth = of(mean_over_units(scene, spreads, method="exact", nodes=3))
    error = 4.5 * found["standard_error"]
    assert found["mean"] == pytest.approx(truth["mean"], abs=error + found["bias"])
    assert found["standard_error"] > 0.0
    assert found["std_between_units"] == pytest.approx(
        truth["std_between_units"], abs=4.5 * math.sqrt(3.0) * found["standard_error"]
    )


SOFT = Viscoelastic(stiffness=40.0, damping_ratio=0.1)
LOSSY = Restitution(coefficient=0.6)
SPREAD = Spread(std=0.1)
CASES: list[tuple[str, Scene, dict[str, Spread]]] = [
    ("exact", between_of_unit_means(Elastic(stiffness=30.0)), {"stiffness": Spread(std=0.2)}),
    (
        "closure",
        between_of_unit_means(LOSSY),
        {"restitution": Spread(half_width=0.2), "clearance": SPREAD},
    ),
    ("exact", between_of_unit_means(Restitution(coefficient=1.0)), {"clearance": SPREAD}),
    (
        "exact",
        between_of_unit_means(Restitution(coefficient=1.0)),
        {"frequency": SPREAD, "level": SPREAD},
    ),
    ("exact", between_of_unit_means(Elastic(stiffness=5.0)), {"clearance": Spread(half_width=0.3)}),
    (
        "exact",
        between_of_unit_means(Elastic(stiffness=30.0), upper=None),
        {"damping": Spread(std=0.2)},
    ),
    (
        "closure",
        between_of_unit_means(SOFT),
        {"stiffness": Spread(half_width=0.5), "damping": SPREAD},
    ),
    ("closure", between_of_unit_means(LOSSY, upper=None), {"clearance": Spread(std=0.2)}),
    ("fokker-planck", between_of_unit_means(LOSSY), {"restitution": Spread(half_width=0.2)}),
    ("fokker-planck", between_of_unit_means(SOFT), {"stiffness": Spread(std=0.2)}),
    ("average", between_of_unit_means(Restitution(coefficient=0.95)), {"level": Spread(std=1.0)}),
    (
        "average",
        between_of_unit_means(Restitution(coefficient=0.95)),
        {"damping": Spread(std=0.15, mean=0.1)},
    ),
]


@quick_cases(("method", "scene", "spreads"), CASES, keep=(0,))
def test_the_mean_is_that_of_many_units(
    method: str, scene: Scene, spreads: dict[str, Spread]
) -> None:
    table = mean_over_units(scene, spreads, method=method)
    stops = np.array(own_distances(model_of(scene)))
    units = Units(scene=scene, spreads=spreads, mean=model_of(scene).mean_gaps, stops=stops)
    points = np.random.default_rng(4).random((80, len(units.columns)))
    quantity = RATE if method != "average" else "x.velocity_mean_square"
    values = [
        float(sweep(units.built(row), {"structure.mass": [1.0]}, method=method)[quantity].iloc[0])
        for row in units.drawn(points)
    ]
    # the method errs alike in both; its bias may be unknown
    found, error = (
        of(table.fillna({"bias": 0.0}), quantity),
        float(np.std(values, ddof=1)) / math.sqrt(len(values)),
    )
    assert found["mean"] == pytest.approx(float(np.mean(values)), abs=4.5 * error + found["bias"])
    # the standard deviation of n values is known to 1 / sqrt(2 n), of a normal distribution
    known = 4.5 * float(np.std(values)) / math.sqrt(len(values))
    assert found["std_between_units"] == pytest.approx(
        float(np.std(values, ddof=1)), abs=known + found["bias"]
    )
    assert found["std_between_units"] > 4.5 * error / math.sqrt(len(values))


def test_spreads_that_have_no_nodes_are_refused() -> None:
    scene = between_of_unit_means(LOSSY)
    with pytest.raises(ValueError, match="nodes of frequency must stay above -95 %"):
        mean_over_units(scene, {"frequency": Spread(std=0.4)}, method="closure", nodes=7)
    with pytest.raises(ValueError, match="at most 10000 combinations of nodes"):
        mean_over_units(scene, {"clearance": SPREAD, "level": SPREAD}, nodes=30)
    with pytest.raises(ValueError, match="method must be one of"):
        mean_over_units(scene, {"clearance": SPREAD}, method="guess")
