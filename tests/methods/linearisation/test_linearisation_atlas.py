"""The bounds that `linearise` and `average` state, and the form that is corrected for clumps of
impacts."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from stochvi.mathematics.impact_rates import TruncatedNormal, cut_laws
from stochvi.methods.averaging import average
from stochvi.methods.closed_form import exact
from stochvi.methods.linearisation import linearise, linearise_many
from stochvi.methods.linearisation.array_closure import Linearised
from stochvi.methods.linearisation.one_form import energy_weight, method_name
from stochvi.model.build_response import ONE, QUANTITIES, TWO, LogErrorInterval, atlas, spans
from stochvi.model.model import model_of
from stochvi.results.base import Response
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes.excitations import ConstantLoad, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator
from stochvi.verification.check import APPROXIMATE, compare
from support import CHECKOUT
from support.accuracies import quick_cases
from support.known import RIGID_STOPS
from support.linearised import make_scene

STUDY = CHECKOUT / "studies" / "13_linearisation_atlas"
WAYS = [("closure", "consistent"), ("motion", "consistent"), ("motion", "book"),
        ("force", "consistent"), ("force", "book"), ("clumps", "consistent"),
        ("closure", "box")]  # fmt: skip
NAMES = dict(
    zip(
        QUANTITIES,
        ("displacement_mean", "displacement_std", "velocity_std", "upcrossing_rate",
         "collision_rate", "impact_speed_rate", "impact_speed_square_rate"),
        strict=True,
    )
)  # fmt: skip


def scene(
    lower: float | None = -1.0,
    upper: float | None = 1.0,
    *,
    restitution: float = 0.8,
    restitution_lower: float | None = None,
    zeta: float = 0.05,
    omega: float = 1.0,
    deviation: float = 1.0,
    load: float = 0.0,
) -> Scene:
    """Stops and load in deviations without stops."""
    own = lower is not None and restitution_lower is not None
    pair = ImpactPair(
        lower=None if lower is None else lower * deviation,
        upper=None if upper is None else upper * deviation,
        law=Restitution(coefficient=restitution),
        lower_law=Restitution(coefficient=restitution_lower) if own else None,
    )
    noise = WhiteNoise(intensity=4.0 * zeta * omega**3 * deviation**2)
    pressed = [ConstantLoad(force=load * omega**2 * deviation)] if load else []
    return Scene(
        structure=Oscillator(mass=1.0, damping=2.0 * zeta * omega, stiffness=omega**2),
        impact_pairs=[pair],
        excitations=[noise, *pressed],
    )


def found(response: Response) -> dict[str, Estimate]:
    return {name: estimate for (_, name), estimate in response.estimates().items()}


def held(
    table: str, every: int, share: float = 1.0, variant: str = "consistent"
) -> tuple[int, int]:
    """How many of the bounds of a closure, or of averaging, times a share, hold on rows of a study;
    of how many.

    The truths are those of the Fokker-Planck equation, at places that no bound was made from.
    """
    with (STUDY / table).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if variant == "box":
        rows = [row for row in rows if row["lower"] != "-inf"]
    rows = rows[::every]
    holding = given = 0
    for row in rows:
        number = {name: float(text) if text else math.nan for name, text in row.items()}
        lower = number["lower"]
        place = scene(
            None if math.isinf(lower) else lower,
            number["upper"],
            restitution=number["restitution_upper"],
            restitution_lower=number["restitution_lower"],
            zeta=number["zeta"],
        )
        averaged = variant == "average"
        response = found(average(place) if averaged else linearise(place, variant=variant))
        for name in QUANTITIES:
            both = number.get(f"{name}_lower", 0.0) + number.get(f"{name}_upper", 0.0)
            truth = number.get(name, both)
            answer = response[NAMES[name]]
            if answer.bias is not None and not math.isnan(truth):
                given += 1
                holding += abs(answer.value - truth) <= share * answer.bias
    return holding, given


@pytest.mark.slow
@quick_cases("variant", ["consistent", "box", "average"], keep=(0, 2))
@pytest.mark.parametrize("table", ["held_out.csv", "held_out_asymmetric.csv"])
def test_bounds_hold_where_none_was_made(table: str, variant: str) -> None:
    every = 10 if variant == "box" and table == "held_out.csv" else 20
    holding, given = held(table, every, variant=variant)
    assert given > 200
    assert holding >= 0.99 * given
    # negative control: a fifth of the bounds does not
    holding, given = held(table, every, share=0.2, variant=variant)
    assert holding < 0.99 * given


@pytest.mark.parametrize(("form", "variant"), WAYS)
@pytest.mark.parametrize("restitution", [0.95, 0.8, 0.5])
def test_covers_reference_numbers(form: str, variant: str, restitution: float) -> None:
    truth = next(row.values for row in RIGID_STOPS if row.restitution == restitution)
    answers = found(linearise(scene(restitution=restitution), form, variant))
    for name in ("displacement_std", "velocity_std", "impact_speed_square_rate"):
        known = truth[name]
        assert answers[name].bias is not None
        assert abs(answers[name].value - known) <= answers[name].bias, name


def test_lookup_does_not_depend_on_units_or_side() -> None:
    one = spans("linearise:closure", model_of(scene(-0.4, 1.3, restitution_lower=0.6, load=0.2)))
    other = scene(-0.4, 1.3, restitution_lower=0.6, load=0.2, omega=75.0, deviation=2e-3)
    mirrored = scene(-1.3, 0.4, restitution=0.6, restitution_lower=0.8, load=-0.2)
    assert isinstance(one, dict)
    for scene_ in (other, mirrored):
        same = spans("linearise:closure", model_of(scene_))
        assert isinstance(same, dict)
        assert same.keys() == one.keys()
        for name, span in one.items():
            assert same[name] == pytest.approx(span, rel=1e-9)


def test_a_span_bounds_powers_and_ratios() -> None:
    """Against every error within it, by brute force."""
    span, other = LogErrorInterval(-0.2, 0.5), LogErrorInterval(-0.1, 0.3)
    truth = np.exp(-np.linspace(-0.2, 0.5, 1001))  # of an answer 1
    for power in (1.0, 2.0):
        assert span.bound(power) == pytest.approx(np.abs(1.0 - truth**power).max(), rel=1e-12)
    ratio = truth[:, None] / np.exp(-np.linspace(-0.1, 0.3, 1001))
    assert span.over(other).bound() == pytest.approx(np.abs(1.0 - ratio).max(), rel=1e-12)


def test_every_form_has_an_atlas_without_holes() -> None:
    for form, variant in WAYS:
        grids = atlas(method_name(form, variant))
        assert grids is not None
        for kind in (TWO, ONE):
            grid = grids[kind]
            # the book's law of the force has no F1, and rates below the collapse have no truth
            names = ("mean", "sigma_x", "sigma_v", "upcrossing", "f2")
            columns = [QUANTITIES.index(name) for name in names]
            assert np.isfinite(grid.errors[..., columns]).all(), (form, kind)
            rates = grid.errors[..., QUANTITIES.index("rate")]
            assert np.isfinite(rates[:, grid.restitutions > 0.163]).all()
            assert np.isnan(rates[:, grid.restitutions < 0.163]).all()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (scene(-9.0, 9.0), "a stop at 9 deviations is outside of the atlas"),
        (scene(zeta=2.0), "zeta = 2 is outside of the atlas"),
        (scene(-0.1, 0.12), "deviations apart are outside of the atlas"),
    ],
)
def test_says_why_there_is_no_bound(changed: Scene, words: str) -> None:
    for estimate in linearise(changed).estimates().values():
        assert estimate.bias is None
        assert words in estimate.how


def test_says_that_tables_have_no_atlas() -> None:
    table = TabulatedNoise(frequency_hz=[0.02, 1.0], density=[0.4, 0.4], unit="N2/Hz")
    changed = scene().model_copy(update={"excitations": (table,)})
    answer = found(linearise(changed))["displacement_std"]
    assert answer.bias is None
    assert "the atlas knows white noise alone" in answer.how
    with pytest.raises(NotApplicable, match="white noise for form 'clumps'"):
        linearise(changed, "clumps")


def test_no_bound_on_a_rate_that_is_infinite() -> None:
    answers = found(linearise(scene(restitution=0.1)))
    assert answers["collision_rate"].bias is None
    assert answers["impact_speed_mean"].bias is None
    assert answers["impact_speed_rate"].bias is not None


def test_exact_answers_stay_exact() -> None:
    for form in ("closure", "clumps"):
        response = linearise(scene(-0.5, 1.0, restitution=1.0, load=0.2), form)
        truth = found(exact(scene(-0.5, 1.0, restitution=1.0, load=0.2)))
        for name, answer in found(response).items():
            assert answer.bias == 0.0
            assert answer.value == pytest.approx(truth[name].value, rel=1e-8), name


def test_check_never_judges_by_the_atlas() -> None:
    """An approximation far beyond its own bound is shown, and the verdict stays."""
    reference, approximate = exact(scene(restitution=1.0)), linearise(scene(restitution=0.8))
    answers = found(approximate)
    assert answers["velocity_std"].bias is not None
    wrong = replace(answers["velocity_std"], value=10.0, bias=1e-6)
    tampered = replace(
        approximate,
        coordinates={"x": {**approximate.coordinates["x"], "velocity_std": wrong}},
    )
    checked = compare([reference], [tampered])
    shown = [row for row in checked.comparisons if row.method == "linearise:closure"]
    assert shown
    assert {row.verdict for row in shown} == {APPROXIMATE}
    assert all(row.tolerance is None for row in shown)
    assert checked.passed


# Which form is best where -----------------------------------------------------------------------


def errors_of(method: str, quantity: str, *, zeta: tuple[float, float], gap: tuple[float, float],
              restitution: tuple[float, float] = (0.0, 0.95)) -> np.ndarray:  # fmt: skip
    """|answer / truth - 1| between two stops on the nodes of the atlas within ranges."""
    grids = atlas(method)
    assert grids is not None
    grid = grids[TWO]
    axes = (grid.gaps, gap), (grid.restitutions, restitution), (grid.zetas, zeta)
    inside = [(low <= axis) & (axis <= high) for axis, (low, high) in axes]
    found = grid.errors[np.ix_(*inside)][..., QUANTITIES.index(quantity)]
    return np.abs(np.expm1(found)).ravel()


@pytest.mark.parametrize("method", ["linearise:closure:box", "linearise:clumps"])
@pytest.mark.parametrize("quantity", ["sigma_x", "sigma_v", "f1"])
def test_error_in_the_range_that_is_asked_for(method: str, quantity: str) -> None:
    """A median of 2 % and 6 % at most: zeta from .05, gaps of half a deviation to one, R from .2.

    The nodes next to the range are .45 and 1 deviation.
    """
    found = errors_of(method, quantity, zeta=(0.05, 0.5), gap=(0.45, 1.0), restitution=(0.2, 1.0))
    assert len(found) == 3 * 9 * 4
    assert np.median(found) < 0.02
    assert found.max() < 0.06
    # negative control: the form of the book does not
    book = errors_of("linearise:motion:book", quantity, zeta=(0.05, 0.5), gap=(0.45, 1.0))
    assert book.max() > 0.06


@pytest.mark.parametrize("gap", [(0.2, 1.0), (1.4, 5.0)])
@pytest.mark.parametrize("quantity", ["sigma_x", "f1"])
def test_a_box_is_better_than_the_plain_closure_above_light_damping(
    gap: tuple[float, float], quantity: str
) -> None:
    before, after = (
        errors_of(method, quantity, zeta=(0.1, 0.5), gap=gap).mean()
        for method in ("linearise:closure", "linearise:closure:box")
    )
    assert after < before


# Clumps ---------------------------------------------------------------------------------------


def test_clumps_mend_light_damping_and_wide_gaps() -> None:
    """F1 of the Fokker-Planck equation, from the grid of the atlas (errors below .2 %)."""
    closure, clumps = (atlas(f"linearise:{form}") for form in ("closure", "clumps"))
    assert closure is not None and clumps is not None
    f1 = QUANTITIES.index("f1")
    for kind, gain in ((TWO, 8.0), (ONE, 4.0)):
        grid = closure[kind]
        wide, light = grid.gaps >= 2.0, grid.zetas <= 0.05
        lossy = grid.restitutions < 1.0
        before, after = (
            np.abs(each[kind].errors[np.ix_(wide, lossy, light)][..., f1]).mean()
            for each in (closure, clumps)
        )
        assert after < before / gain


def test_clumps_keep_the_balance_of_energy() -> None:
    response = linearise(scene(-2.0, 3.0, restitution=0.5, zeta=0.02), "clumps")
    assert abs(response.identities["energy"].value) < 1e-9


def test_weight_of_the_energy_runs_from_preload_to_wide_gaps() -> None:
    weights = [
        energy_weight(model_of(scene(None, gap, zeta=0.02))) for gap in (-1.0, 0.0, 1.0, 4.0)
    ]
    assert weights[:2] == [0.0, 0.0]
    assert weights[2:] == pytest.approx([1.0 / 2.0, 4.0 / 5.0], rel=1e-12)
    pressed = linearise(scene(None, -1.0, zeta=0.02), "clumps")
    same = linearise(scene(None, -1.0, zeta=0.02))
    assert found(pressed)["velocity_std"].value == found(same)["velocity_std"].value


# ------------------------------------------------------------------------------
# Arrays of oscillators linearised at once: against `linearise`, exact laws and the balances.
# ------------------------------------------------------------------------------


Columns = dict[str, np.ndarray]


def random_columns(rng: np.random.Generator, size: int, *, elastic: bool = False) -> Columns:
    """Any rigid stops: gaps of 1e-6 to 1e3 deviations, any R, preload, load, S0 over 20 decades."""
    omega = 10.0 ** rng.uniform(-2.0, 3.0, size)
    damping = 2.0 * omega * 10.0 ** rng.uniform(-4.0, 0.5, size)
    intensity = 10.0 ** rng.uniform(-12.0, 8.0, size)
    deviation = np.sqrt(intensity / (2.0 * damping)) / omega
    near, far = 10.0 ** rng.uniform(-6.0, 3.0, (2, size))
    preload = rng.uniform(0.0, 3.0, size)
    kind = rng.integers(0, 6, size)
    kinds = [kind == k for k in range(5)]
    nothing = np.full(size, np.inf)
    lower = np.select(kinds, [-near, -near, -nothing, -nothing, -near], -preload - near)
    upper = np.select(kinds, [near, far, near, -preload, nothing], -preload)
    one, two = rng.uniform(size=(2, size))
    one = np.where(rng.uniform(size=size) < 0.1, 0.0, one)
    two = np.where(rng.uniform(size=size) < 0.3, one, two)
    two = np.where(rng.uniform(size=size) < 0.05, 1.0, two)
    if elastic:
        one = two = np.ones(size)
    pressed = rng.uniform(size=size) < 0.5
    return {
        "omega": omega,
        "damping_rate": damping,
        "intensity": intensity,
        "load": np.where(pressed, rng.uniform(-3.0, 3.0, size), 0.0) * deviation * omega**2,
        "lower": lower * deviation,
        "upper": upper * deviation,
        "restitution_lower": one,
        "restitution_upper": two,
    }


def scene_of(columns: Columns, k: int) -> Scene:
    row = {name: float(column[k]) for name, column in columns.items()}
    laws = {
        side: None if math.isinf(row[side]) else Restitution(coefficient=row[f"restitution_{side}"])
        for side in ("lower", "upper")
    }
    pair = ImpactPair(
        lower=row["lower"] if laws["lower"] else None,
        upper=row["upper"] if laws["upper"] else None,
        law=laws["upper"] or laws["lower"],
        lower_law=laws["lower"] if laws["upper"] else None,
    )
    load = [ConstantLoad(force=row["load"])] if row["load"] else []
    return Scene(
        structure=Oscillator(mass=1.0, damping=row["damping_rate"], stiffness=row["omega"] ** 2),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=row["intensity"]), *load],
    )


def value(response: Response, name: str) -> float:
    groups = [*response.coordinates.values(), *response.impact_pairs.values()]
    found = next(group[name] for group in groups if name in group)
    assert isinstance(found, Estimate)
    return found.value


def differences(found: Linearised, k: int, other: Response) -> dict[str, float]:
    """Relative; of the mean in deviations; rates also to 1e-30 of the least time there is."""
    deviation = math.sqrt(found.variance[k])
    speed = math.sqrt(found.velocity_mean_square[k])
    mine = {
        "displacement_std": deviation,
        "velocity_std": speed,
        "collision_rate": found.rate_lower[k] + found.rate_upper[k],
        "impact_speed_rate": found.speed_rate_lower[k] + found.speed_rate_upper[k],
        "impact_speed_square_rate": found.speed_square_rate_lower[k]
        + found.speed_square_rate_upper[k],
    }
    floors = {"collision_rate": 1.0, "impact_speed_rate": speed, "impact_speed_square_rate": 1.0}
    apart = {}
    for name, number in mine.items():
        floor = 1e-30 * floors.get(name, 0.0) * speed / deviation * max(1.0, speed**2)
        apart[name] = abs(number - value(other, name)) / (value(other, name) + floor)
    apart["mean"] = abs(found.mean[k] - value(other, "displacement_mean")) / deviation
    return apart


def test_laws_agree_with_those_of_one_scene() -> None:
    rng = np.random.default_rng(0)
    size = 200
    lower, upper = -(10.0 ** rng.uniform(-3, 2, size)), 10.0 ** rng.uniform(-3, 2, size)
    curvature = rng.normal(size=size) * 10.0 ** rng.uniform(-3, 3, size) / (upper - lower) ** 2
    slope = rng.normal(size=size) * 10.0 ** rng.uniform(-3, 2, size) / (upper - lower)
    found = cut_laws(slope, curvature, lower, upper)
    for k in range(size):
        law = TruncatedNormal(
            slope=slope[k], curvature=curvature[k], lower=float(lower[k]), upper=float(upper[k])
        )
        deviation = math.sqrt(law.variance)
        assert found.mean[k] == pytest.approx(law.mean, abs=1e-10 * deviation)
        assert found.variance[k] == pytest.approx(law.variance, rel=1e-10)
        for stop, density in ((upper[k], found.upper[k]), (lower[k], found.lower[k])):
            assert density == pytest.approx(law.density_at(float(stop)), rel=1e-9, abs=1e-290)


def test_agrees_with_linearise() -> None:
    columns = random_columns(np.random.default_rng(1), 60)
    found = linearise_many(**columns)
    for k in range(60):
        apart = differences(found, k, linearise(scene_of(columns, k)))
        assert max(apart.values()) < 1e-9, (k, apart)


def test_exact_for_elastic_stops() -> None:
    columns = random_columns(np.random.default_rng(2), 100, elastic=True)
    found = linearise_many(**columns)
    for k in range(100):
        apart = differences(found, k, exact(scene_of(columns, k)))
        assert max(apart.values()) < 1e-10, (k, apart)


def test_another_restitution_would_be_seen() -> None:
    """Negative control: R = .999 in place of 1 is far outside of the tolerance above."""
    columns = random_columns(np.random.default_rng(2), 200, elastic=True)
    wrong = linearise_many(**columns | {"restitution_upper": 0.999})
    hits = wrong.rate_upper * np.sqrt(columns["intensity"]) > 1e-3
    theta = columns["intensity"] / (2.0 * columns["damping_rate"])
    assert (np.abs(wrong.velocity_mean_square / theta - 1.0) > 1e-10).sum() > hits.sum() / 2 > 10


def balances(columns: Columns, found: Linearised) -> np.ndarray:
    """Residuals of energy, virial and force, relative to their largest terms."""
    c = columns
    lower = np.where(np.isfinite(c["lower"]), c["lower"], 0.0)
    upper = np.where(np.isfinite(c["upper"]), c["upper"], 0.0)
    low, high = 1.0 + c["restitution_lower"], 1.0 + c["restitution_upper"]
    square = found.velocity_mean_square
    loss = (1.0 - c["restitution_lower"] ** 2) * found.speed_square_rate_lower
    loss = loss + (1.0 - c["restitution_upper"] ** 2) * found.speed_square_rate_upper
    push, pull = low * found.speed_rate_lower, high * found.speed_rate_upper
    spring = c["omega"] ** 2
    away = spring * found.mean - c["load"]
    virial = spring * found.variance + push * (found.mean - lower) + pull * (upper - found.mean)
    return np.array(
        [
            (c["damping_rate"] * square + loss / 2.0) / (c["intensity"] / 2.0) - 1.0,
            virial / square - 1.0,
            (away + pull - push) / (np.abs(away) + pull + push + spring * np.sqrt(found.variance)),
        ]
    )


def test_every_one_of_many_thousand_is_answered() -> None:
    columns = random_columns(np.random.default_rng(3), 40_000)
    found = linearise_many(**columns)
    assert found.converged.all()
    assert all(np.isfinite(column).all() for column in found)
    assert (found.variance > 0.0).all()
    assert (found.rate_lower >= 0.0).all() and (found.rate_upper >= 0.0).all()
    # the distance from a stop is known to the rounding of the stop's place
    place = np.nan_to_num(
        np.maximum(np.abs(columns["lower"]), np.abs(columns["upper"])), posinf=0.0
    )
    place = np.maximum(place, np.abs(found.mean))
    rounding = 8.0 * np.finfo(float).eps * place / np.sqrt(found.variance)
    assert (np.abs(balances(columns, found)) < 1e-9 + rounding).all()
    wrong = columns | {"restitution_upper": columns["restitution_upper"] ** 2}
    assert np.abs(balances(wrong, found)).max() > 1e-2


def test_without_spring_or_damper() -> None:
    columns = {
        "omega": np.array([0.0, 0.0, 1.0, 0.0]),
        "damping_rate": np.array([0.1, 0.0, 0.0, 0.0]),
        "intensity": 0.2,
        "load": np.array([0.0, 0.0, 0.0, 1.0]),
        "lower": np.array([-1.0, -1.0, -np.inf, -np.inf]),
        "upper": 1.0,
        "restitution_lower": 0.5,
        "restitution_upper": 0.5,
    }
    found = linearise_many(**columns)
    assert found.converged.all()
    assert np.abs(balances(columns, found)).max() < 1e-9


def test_a_rate_of_1e_300_is_a_number() -> None:
    found = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=[-37.0], upper=37.0,
        restitution_lower=0.5, restitution_upper=0.5,
    )  # fmt: skip
    expected = 2.0 * math.exp(-(37.0**2) / 2.0) / (2.0 * math.pi)
    assert found.rate_lower[0] + found.rate_upper[0] == pytest.approx(expected, rel=1e-9)
    assert expected < 1e-297


def test_broadcasts_and_keeps_the_shape() -> None:
    gap = np.array([0.5, 1.0, 2.0])[:, None]
    found = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=-gap, upper=gap,
        restitution_lower=[0.2, 0.8], restitution_upper=[0.2, 0.8],
    )  # fmt: skip
    assert {column.shape for column in found} == {(3, 2)}
    alone = linearise_many(
        omega=1.0, damping_rate=0.1, intensity=0.2, lower=-2.0, upper=2.0,
        restitution_lower=0.8, restitution_upper=0.8,
    )  # fmt: skip
    assert found.variance[2, 1] == pytest.approx(float(alone.variance), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"omega": np.nan}, ValueError, "omega must be numbers"),
        ({"intensity": -1.0}, ValueError, "intensity must be at least 0"),
        ({"intensity": 0.0}, NotApplicable, "intensity must be positive"),
        ({"restitution_upper": 1.2}, ValueError, "restitution_upper must be in"),
        ({"lower": 2.0}, ValueError, "lower must be below upper"),
        ({"omega": np.inf}, ValueError, "omega must be finite"),
        ({"omega": 0.0, "lower": -np.inf}, NotApplicable, "omega must be positive"),
        (
            {"damping_rate": 0.0, "restitution_upper": 1.0, "restitution_lower": 1.0},
            NotApplicable,
            "damping_rate must be positive",
        ),
    ],
)
def test_refuses_in_words(change: dict[str, float], error: type[Exception], words: str) -> None:
    right = {
        "omega": 1.0, "damping_rate": 0.1, "intensity": 0.2, "lower": -1.0, "upper": 1.0,
        "restitution_lower": 0.8, "restitution_upper": 0.8,
    }  # fmt: skip
    with pytest.raises(error, match=words):
        linearise_many(**right | change)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_a_weight_on_a_lossy_stop_is_answered_alone_as_in_an_array(
    side: float, damping: float, restitution: float
) -> None:
    """Neither spring nor damper sets a speed: only the load and the noise do."""
    ends = (None, 0.3) if side > 0.0 else (-0.3, None)
    alone = linearise(
        make_scene(*ends, restitution=restitution, stiffness=0.0, damping=damping, load=side)
    )
    array = linearise_many(
        omega=0.0,
        damping_rate=damping,
        intensity=0.2,
        load=1.0,
        upper=0.3,
        restitution_upper=restitution,
    )
    x, stops = alone.coordinates["x"], alone.impact_pairs["stops"]
    assert x["displacement_mean"].value == pytest.approx(side * float(array.mean), rel=1e-9)
    assert x["displacement_std"].value ** 2 == pytest.approx(float(array.variance), rel=1e-9)
    assert stops["collision_rate"].value == pytest.approx(float(array.rate_upper), rel=1e-9)
