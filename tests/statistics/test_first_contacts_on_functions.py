"""First contacts on springs and dampers that are functions, judged by linear mounts that are
written as functions, by plain missions and by a splitting of another kind, both in NumPy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from stochvi import ConstantLoad, Isolator, Scene, WhiteNoise, reliability, screen, simulate, size
from stochvi.isolators.tolerances import Tolerances
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_histories
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.scenes.characteristics import BoucWen, Coulomb, Duffing, SpringTable
from stochvi.scenes.excitations import Sine, TabulatedNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.phases import Phase
from stochvi.scenes.scene import ImpactPair
from stochvi.scenes.structures.rigid_body import Mount, RigidBody
from stochvi.statistics.free_flights import FreeFlights, linearised, windows_of
from support.refusals import refusals
from tests.support.plain_mounts import G, PlainMount

DENSITY = 0.01
"""Density of the noise, g^2/Hz."""

BAND = (3.0, 60.0)
"""Ends of the noise that is a table, Hz."""

WHITE = WhiteNoise(density=DENSITY, unit="g2/Hz")
TABLE = TabulatedNoise(frequency_hz=BAND, density=[DENSITY, DENSITY], unit="g2/Hz")

Z = 4.5
"""Standard errors that two right numbers may be apart."""


def mount(clearance: float, noise: Any = WHITE, **structure: Any) -> Scene:
    """A box of 10 kg between rigid stops."""
    return Scene(
        structure=Isolator(**{"mass": 10.0, "stiffness": 2e4, "damping": 20.0} | structure),
        impact_pairs=[ImpactPair(clearance=clearance, law=Restitution(coefficient=0.5))],
        excitations=[noise],
    )


@dataclass(frozen=True)
class Case:
    """A mount as the package knows it, and the same in NumPy."""

    structure: dict[str, Any]
    plain: PlainMount
    omega: float


def bent(x: np.ndarray) -> np.ndarray:
    """The force of the table of `CASES`."""
    size = np.abs(x)
    return np.sign(x) * np.where(size < 0.004, 3e4 * size, 120.0 + 4e4 / 3.0 * (size - 0.004))


QUIET = PlainMount(stiffness=2e4, damping=20.0, intensity=0.5 * DENSITY * G**2, step=1e-3)
CASES = {
    "wire rope": Case(
        {"spring": BoucWen(stiffness=6e4, yield_displacement=5e-4)},
        replace(QUIET, hysteresis=(6e4, 5e-4)), 45.0,
    ),
    "rubber": Case(
        {"damping": 60.0, "spring": Duffing(cubic_stiffness=1e9)},
        replace(QUIET, damping=60.0, spring=lambda x: 1e9 * x**3, step=5e-4), 110.0,
    ),
    "measured": Case(
        {"stiffness": 0.0, "damping": 60.0,
         "spring": SpringTable(deflection=[0.0, 0.004, 0.04], force=[0.0, 120.0, 600.0])},
        replace(QUIET, stiffness=0.0, damping=60.0, spring=bent), 45.0,
    ),
    "friction": Case({"damper": Coulomb(force=15.0)}, replace(QUIET, friction=15.0), 45.0),
}  # fmt: skip


def chance_of(scene: Scene, mission: float, rel_error: float, seed: int = 1) -> Estimate:
    """The probability of any impact."""
    found = reliability(scene, mission=mission, rel_error=rel_error, budget=None, seed=seed)
    return found.chances["hit"].estimate


def apart(found: Estimate, value: float, error: float) -> float:
    """How many standard errors an estimate is from a number, beyond its bias."""
    away = max(abs(found.value - value) - (found.bias or 0.0), 0.0)
    return away / math.hypot(found.standard_error, error)


def counted(case: Case, clearance: float, mission: float, paths: int, band: bool) -> Any:
    """Probability by plain missions, and its standard error."""
    plain = replace(case.plain, intensity=0.0) if band else case.plain
    batches = 8 if band else 1
    farthest = np.concatenate(
        [
            plain.farthest(
                paths // batches, mission, 3.0, seed, (*BAND, DENSITY * G**2) if band else None
            )
            for seed in range(batches)
        ]
    )
    share = float(np.mean(farthest >= clearance))
    return share, math.sqrt(share * (1.0 - share) / len(farthest))


def linear_table(clearance: float) -> Scene:
    """A linear mount whose spring is a table."""
    spring = SpringTable(deflection=[0.0, 0.1], force=[0.0, 2000.0])
    return mount(clearance, TABLE, stiffness=0.0, damping=60.0, spring=spring)


def pieces_of(scene: Scene) -> FreeFlights:
    """Pieces of the motion of a scene, up to the stops."""
    model = model_of(scene)
    found = windows_of(model, [0.01], [0.01], 100.0, 3)
    assert isinstance(found, FreeFlights)
    return found


def test_on_a_linear_spring_pieces_are_the_linear_motion() -> None:
    pieces = pieces_of(linear_table(0.01))
    numbers = pieces.fresh(0).records[:4]
    samples, modes = pieces.plan.samples, pieces.plan.modes.size
    free = np.fft.irfft(pieces.transform(numbers, samples), samples, axis=0)[:, :modes]
    linear = np.einsum("gm,smp->sgp", pieces.directions, free)[: pieces.counted]
    flown = pieces.flown(numbers, pieces.counted)
    np.testing.assert_allclose(flown, linear, atol=1e-9 * np.abs(linear).max())
    # negative control: of a spring that bends they are another motion
    other = pieces_of(mount(0.01, TABLE, **CASES["measured"].structure))
    bent_numbers = other.fresh(0).records[:4]
    free = np.fft.irfft(other.transform(bent_numbers, other.plan.samples), axis=0)[:, :1]
    linear = np.einsum("gm,smp->sgp", other.directions, free)[: other.counted]
    assert np.abs(other.flown(bent_numbers, other.counted) - linear).max() > 1e-4


def test_pieces_of_a_mount_without_functions_are_its_motion() -> None:
    """Those of a linear table of the same stiffness, by a mount that has no function at all."""
    scene = linear_table(0.01)
    plain = model_of(scene.replace(structure=Isolator(mass=10.0, stiffness=2e4, damping=60.0)))
    like = pieces_of(scene)
    pieces = replace(like, model=plain)
    assert pieces.window == pytest.approx(like.window, rel=1e-9)
    assert pieces.moving.tolist() == [0]
    numbers = pieces.fresh(0).records[:4]
    samples = pieces.plan.samples
    free = np.fft.irfft(pieces.transform(numbers, samples), samples, axis=0)[:, :1]
    linear = np.einsum("gm,smp->sgp", pieces.directions, free)[: pieces.counted]
    flown = pieces.flown(numbers, pieces.counted)
    np.testing.assert_allclose(flown, linear, atol=1e-9 * np.abs(linear).max())


test_what_is_not_known_on_functions_is_refused = refusals(
    lambda scene, arguments: reliability(scene, mission=10.0, **arguments),
    (mount(0.01, damper=Coulomb(force=5.0)), {"impact_speed": 0.1}, "any impact alone"),
    (mount(0.01, damper=Coulomb(force=5.0)), {"start": "rest"}, "stationary start"),
    (
        mount(0.01, damper=Coulomb(force=5.0)).replace(
            excitations=[WHITE, Sine(amplitude=1.0, frequency_hz=20.0)]
        ),
        {},
        "sines must be left out",
    ),
    error=NotApplicable,
)


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [0.020, pytest.param(0.026, marks=pytest.mark.verify)])
def test_a_linear_mount_written_as_a_table_is_hit_as_often(clearance: float) -> None:
    """First crossings of the linear mount: 2 % and 2e-5 in a minute."""
    found = chance_of(linear_table(clearance), 60.0, 0.1)
    linear = chance_of(mount(clearance, TABLE, damping=60.0), 60.0, 0.02)
    assert apart(found, linear.value, linear.standard_error) < Z
    # negative control: a tenth more clearance
    other = chance_of(mount(1.1 * clearance, TABLE, damping=60.0), 60.0, 0.02)
    assert apart(found, other.value, other.standard_error) > Z


@pytest.mark.slow
def test_wire_rope_is_hit_as_often_as_in_plain_missions() -> None:
    case = CASES["wire rope"]
    found = chance_of(mount(0.011, **case.structure), 5.0, 0.1)
    plain = counted(case, 0.011, 5.0, 500, band=False)
    assert apart(found, *plain) < Z
    # negative control: the linear mount of the same motion
    model = linearised(model_of(mount(0.011, **case.structure)))
    stiffness, damping = float(model.stiffness[0, 0]), float(model.damping[0, 0])
    linear = mount(0.011, stiffness=stiffness, damping=damping)
    assert apart(chance_of(linear, 5.0, 0.05), *plain) > Z


PLAIN: Sequence[tuple[str, bool, float, float, float]] = [
    ("wire rope", False, 0.010, 10.0, 0.05),
    ("wire rope", False, 0.014, 10.0, 0.05),
    ("wire rope", True, 0.0115, 10.0, 0.05),
    ("rubber", False, 0.0095, 10.0, 0.05),
    ("rubber", True, 0.0095, 10.0, 0.05),
    ("measured", False, 0.018, 10.0, 0.05),
    ("measured", True, 0.018, 10.0, 0.05),
    ("friction", False, 0.016, 10.0, 0.05),
    ("friction", True, 0.016, 10.0, 0.05),
]
"""Mounts, whether a table shakes them, clearances, m, missions, s, and relative errors."""


@pytest.mark.verify
@pytest.mark.parametrize(("name", "band", "clearance", "mission", "rel_error"), PLAIN)
def test_plain_missions(
    name: str, band: bool, clearance: float, mission: float, rel_error: float
) -> None:
    case = CASES[name]
    found = chance_of(
        mount(clearance, TABLE if band else WHITE, **case.structure), mission, rel_error
    )
    share, error = counted(case, clearance, mission, 4000, band)
    assert share * 4000 > 20, "too few are hit to judge anything"
    assert apart(found, share, error) < Z
    assert apart(found, *counted(case, 1.15 * clearance, mission, 4000, band)) > Z


def levels(clearance: float) -> list[float]:
    """Levels of amplitude up to a clearance."""
    return (clearance * np.linspace(0.2, 0.97, 18)).tolist()


RARE = [
    ("wire rope", 0.022, 0.1), ("rubber", 0.0125, 0.15), ("measured", 0.030, 0.1),
    ("friction", 0.026, 0.1),
]  # fmt: skip
"""Mounts, clearances, m, and relative errors."""


@pytest.mark.verify
@pytest.mark.parametrize(("name", "clearance", "rel_error"), RARE)
def test_rare_contacts_are_as_frequent_as_by_levels_of_amplitude(
    name: str, clearance: float, rel_error: float
) -> None:
    """1e-3 to 1e-6 in a minute, and the judge itself by plain missions at a nearer stop."""
    case = CASES[name]

    def judged(place: float) -> tuple[float, float]:
        rates = [case.plain.rate(place, levels(place), case.omega, 800, seed) for seed in range(8)]
        return float(np.mean(rates)), float(np.std(rates, ddof=1) / math.sqrt(len(rates)))

    near = {"wire rope": 0.014, "rubber": 0.0095, "measured": 0.018, "friction": 0.018}[name]
    share, error = counted(case, near, 20.0, 4000, band=False)
    rate, off = judged(near)
    hazard, unsure = -math.log1p(-share), error / (1.0 - share)
    # a mission begins beyond the stop, or in a cluster, as often as in half a second at most
    assert -Z * math.hypot(unsure, 20.0 * off) < hazard - 20.0 * rate
    assert hazard - 20.5 * rate < Z * math.hypot(unsure, 20.0 * off)
    rate, off = judged(clearance)
    found = chance_of(mount(clearance, **case.structure), 60.0, rel_error)
    assert apart(found, -math.expm1(-60.0 * rate), 60.0 * off) < Z
    # negative control: a tenth more clearance
    rate, off = judged(1.1 * clearance)
    assert apart(found, -math.expm1(-60.0 * rate), 60.0 * off) > Z


def test_loads_and_tolerances_beside_functions_are_refused() -> None:
    hanging = mount(0.01, damper=Coulomb(force=5.0)).replace(
        excitations=[WHITE, ConstantLoad(acceleration=9.81)]
    )
    with pytest.raises(NotApplicable, match="let reliability judge the stops"):
        size(hanging, probability=0.01)
    with pytest.raises(NotApplicable, match="tolerances must be of the level alone"):
        size(
            mount(0.01, damper=Coulomb(force=5.0)), probability=0.01,
            tolerances=Tolerances(frequency=0.05),
        )  # fmt: skip
    with pytest.raises(NotApplicable, match="clearance counts the impacts on any mount"):
        size(mount(0.01, damper=Coulomb(force=5.0)), rate=1.0)


def test_a_screening_says_that_the_mount_is_linearised() -> None:
    case = CASES["measured"]
    found = screen(mount(0.01, TABLE, **case.structure))
    assert any("linearised at its own rms motion" in each for each in found.notes)
    random = simulate(mount(1.0, TABLE, **case.structure), paths=64, duration=5.0, seed=1)
    rms = random.coordinates["x"].displacement_std
    assert rms is not None
    # it states no bound; a piecewise linear spring is far from its closure by a few per cent
    assert abs(found.displacement_std - rms.value) < 0.1 * rms.value


@pytest.mark.slow
@pytest.mark.parametrize(
    "shares", [(1.0,), pytest.param((0.5, 0.3, 0.2), marks=pytest.mark.verify)]
)
def test_a_sized_clearance_keeps_its_probability(shares: Sequence[float]) -> None:
    """In a mission of one phase or several, by another seed."""
    case, mission, wanted = CASES["measured"], 60.0, 0.05
    phases = [Phase(name=f"part {k}", duration=mission * each) for k, each in enumerate(shares)]

    def at(clearance: float) -> Scene:
        scene = mount(clearance, TABLE, **case.structure)
        return scene.replace(phases=phases) if len(shares) > 1 else scene

    lasting = None if len(shares) > 1 else mission
    sized = size(at(0.02), probability=wanted, mission=lasting, rel_error=0.3, budget=600.0)
    place = sized.clearance.value

    def risk(clearance: float) -> Estimate:
        found = reliability(at(clearance), mission=lasting, rel_error=0.2, budget=600.0, seed=7)
        return found.chances["hit"].estimate

    curve = sized.curve
    lower, upper = (
        float(np.interp(place, curve["clearance"], curve[name]))
        for name in ("probability_low", "probability_high")
    )
    error = (upper - lower) / 4.0
    assert abs(float(np.interp(place, curve["clearance"], curve["probability"])) - wanted) < 1e-3
    assert apart(risk(place), wanted, error) < Z
    # negative control: 4 mm more
    assert apart(risk(place + 0.004), wanted, error) > Z


@pytest.mark.verify
def test_a_box_on_wire_rope_is_hit_as_often_as_in_plain_histories() -> None:
    rope = BoucWen(stiffness=2e4, yield_displacement=5e-4, axis="z")
    corners = [(0.22, 0.16), (0.22, -0.14), (-0.18, 0.16), (-0.18, -0.14)]
    scene = Scene(
        structure=RigidBody(
            mass=12.0, inertia=[0.20, 0.25, 0.15],
            mounts=[
                Mount(at=[x, y, -0.06], stiffness=[1e4] * 3, loss_factor=0.1, spring=rope)
                for x, y in corners
            ],
        ),
        impact_pairs=[
            ImpactPair(
                name="corner", at=[0.24, 0.18, -0.08], direction=[0, 0, 1], clearance=0.009,
                law=Restitution(coefficient=0.4),
            )
        ],
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz", axis="z")],
    )  # fmt: skip
    (pair,) = model_of(scene).pairs
    plan = plan_histories(scene.replace(impact_pairs=())).sampled(1.0 / 400.0, 10.0)
    farthest = [
        np.abs(
            np.tensordot(
                pair.direction, plan.histories(5, k * plan.block, plan.block).displacement, axes=1
            )
        ).max(axis=1)
        for k in range(20)
    ]
    hit = np.concatenate(farthest) >= 0.009
    share = float(hit.mean())
    error = math.sqrt(share * (1.0 - share) / len(hit))
    found = chance_of(scene, 10.0, 0.1)
    assert apart(found, share, error) < Z
    assert apart(chance_of(scene, 20.0, 0.1), share, error) > Z
