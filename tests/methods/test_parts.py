"""Compiling takes nothing from a budget."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import stochvi
from stochvi import (
    ConstantLoad,
    Elastic,
    Estimate,
    ForceFunction,
    Hertz,
    ImpactPair,
    Isolator,
    NotApplicable,
    Oscillator,
    RecordedNoise,
    Response,
    Restitution,
    Scene,
    SceneError,
    Sine,
    SpeedRestitution,
    WhiteNoise,
    average,
    exact,
    explain,
    fokker_planck,
    harmonic_response,
    linearise,
    load_scene,
    reliability,
    replay,
    simulate,
    transient,
)
from stochvi.engine.arithmetic import uniform_of
from stochvi.engine.calls import functions_of, mean_rebound_of, rebound_of, row_of_numbers
from stochvi.engine.parts import is_rigid, rebound
from stochvi.identification import Rebounds, identify
from stochvi.isolators.jolt_response import perturbations
from stochvi.mathematics.impact_rates import (
    COLLAPSE_RESTITUTION,
    BetaDistribution,
    corner_exponent,
    equivalent_restitution,
)
from stochvi.methods.closed_form import unmet as unmet_by_exact
from stochvi.methods.fokker_planck import fokker_planck_density
from stochvi.methods.periodic import RelayBetweenStops, SwitchedDrive
from stochvi.methods.replay.march import SampledExcitation, integrate, rest_of
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.modal import plan_modal
from stochvi.results.deadline import Deadline, graceful_interrupt, showing, stood_still
from stochvi.results.errors import Interrupted
from stochvi.sampling import workers
from stochvi.sampling.checkpoints import digest_of
from stochvi.sampling.workers import leave_out_of_budgets, outside_budgets, packed, unpacked
from stochvi.scenes import Rayleigh, Relay
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.impact_laws.rigid import viscoelastic_restitution
from stochvi.scenes.scene import scene_from
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.accuracies import assert_differs, quick_cases
from support.known import changed, to_toml, values
from support.pairs import diagonal
from support.refusals import refusals
from support.relays import RelayTwin
from support.soft_stops import scene

# ------------------------------------------------------------------------------
# Forces of stops that are functions of a user's own: followed, told, refused.
# ------------------------------------------------------------------------------


K, N, A = 200.0, 1.4, 0.3


def hunt_crossley(y: float, v: float) -> float:
    return K * y**N * (1.0 + A * v)


def ball(y: float, v: float) -> float:
    return 100.0 * y**1.5


def stored(y: float) -> float:
    return 40.0 * y**2.5


OWN = ForceFunction(force=hunt_crossley)
BALL = ForceFunction(force=ball, energy=stored)

# ---- simulate ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated() -> dict[str, Any]:
    found = simulate(scene(-1.0, 1.0, BALL), paths=512, duration=400.0, seed=2)
    return {quantity: each for (_, quantity), each in found.estimates().items()}


@pytest.mark.slow
def test_a_function_without_losses_has_the_exact_law_of_its_shipped_twin(simulated) -> None:
    truth = values(exact(scene(-1.0, 1.0, Hertz(coefficient=100.0))))
    compared = [name for name, each in simulated.items() if name in truth and each.standard_error]
    assert len(compared) > 10
    for name in compared:
        assert_agrees(simulated[name], truth[name])
    assert values(exact(scene(-1.0, 1.0, BALL))) == pytest.approx(truth, rel=1e-9, abs=1e-12)


def test_a_stop_a_tenth_stiffer_is_told_from_it(simulated) -> None:
    """The negative control of the comparison above."""
    truth = values(exact(scene(-1.0, 1.0, Hertz(coefficient=110.0))))["peak_force"]
    found = simulated["peak_force"]
    assert abs(found.value - truth) > 4.5 * found.standard_error


# ---- replay -----------------------------------------------------------------------------------

STEP, SAMPLES = 0.1, 300


def marched(structure: Oscillator | Matrices, law: Law, forces: np.ndarray, **pair: object):
    case = Scene(
        structure=structure,
        impact_pairs=[ImpactPair(lower=-1.0, upper=0.7, law=law, **pair)],
        excitations=[WhiteNoise(intensity=0.2, on=pair.get("on", "x"))],
    )
    model = model_of(case)
    shaking = SampledExcitation(step=STEP, forces=forces, base=np.zeros(len(forces)))
    return integrate(model, shaking, rest_of(model))


ONE = Oscillator(mass=2.0, damping=0.1, stiffness=3.0)
TWO = Matrices(
    coordinates=["a", "b"],
    mass=np.diag([2.0, 1.0]),
    damping=[[0.2, -0.1], [-0.1, 0.1]],
    stiffness=[[5.0, -2.0], [-2.0, 2.0]],
)


def plain(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, forces: np.ndarray,
    push: Callable[[float, float], float],
) -> np.ndarray:  # fmt: skip
    """Displacements of the samples by a general solver; the last coordinate hits the stops."""
    n = len(mass)

    def rate(t: float, state: np.ndarray, k: int) -> np.ndarray:
        x, v = state[:n], state[n:]
        total = forces[k] + (forces[k + 1] - forces[k]) * (t / STEP - k)
        total = total - damping @ v - stiffness @ x
        for side, stop in ((1.0, 0.7), (-1.0, 1.0)):
            y = side * x[-1] - stop
            if y > 0.0:
                total[-1] -= side * max(push(y, side * v[-1]), 0.0)
        return np.concatenate([v, np.linalg.solve(mass, total)])

    state, found = np.zeros(2 * n), [np.zeros(n)]
    for k in range(SAMPLES - 1):
        span = (k * STEP, (k + 1) * STEP)
        solved = solve_ivp(
            rate, span, state, args=(k,), method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.01
        )
        state = solved.y[:, -1]
        found.append(state[:n])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("several", [False, True])
def test_a_replay_with_a_function_is_that_of_a_general_solver(several: bool) -> None:
    forces = 5.0 * np.random.default_rng(1).normal(size=(SAMPLES, 2 if several else 1))
    found = marched(TWO, OWN, forces, on="b") if several else marched(ONE, OWN, forces)
    matrices = (
        [np.array(each) for each in (TWO.mass, TWO.damping, TWO.stiffness)]
        if several
        else [np.array([[each]]) for each in (2.0, 0.1, 3.0)]
    )
    twin = plain(*matrices, forces, hunt_crossley)
    assert len(found.impacts) > 3
    assert found.displacement == pytest.approx(twin, abs=1e-6 * np.abs(twin).max())
    # the negative control: without the loss of the force the motion is another one
    other = plain(*matrices, forces, lambda y, v: hunt_crossley(y, 0.0))
    assert np.abs(found.displacement - other).max() > 1e-3


def test_a_replay_takes_a_function_as_its_shipped_twin() -> None:
    forces = 5.0 * np.random.default_rng(3).normal(size=(SAMPLES, 1))
    one, other = (marched(ONE, law, forces) for law in (Hertz(coefficient=100.0), BALL))
    assert len(one.impacts) > 3
    assert other.displacement == pytest.approx(one.displacement, abs=1e-10)
    assert other.impacts == pytest.approx(one.impacts, rel=1e-7)


def test_a_function_may_call_others_and_may_be_compiled_before() -> None:
    forces = 5.0 * np.random.default_rng(4).normal(size=(SAMPLES, 1))
    root = math.sqrt

    def helped(y: float, v: float) -> float:
        return 10.0 * ball(y, v) / root(100.0)

    found = [
        marched(ONE, ForceFunction(force=each), forces).displacement
        for each in (ball, helped, numba.njit(ball))
    ]
    assert found[1] == pytest.approx(found[0], abs=1e-9)
    assert np.array_equal(found[2], found[0])


def test_another_process_finds_a_function_by_its_name() -> None:
    law = unpacked(packed(model_of(scene(-1.0, 1.0, OWN)))).upper.law
    assert law.force is hunt_crossley
    assert digest_of(law) == digest_of(model_of(scene(-1.0, 1.0, OWN)).upper.law)


# ---- what is told -----------------------------------------------------------------------------


def test_the_document_names_the_function_and_tells_versions_apart() -> None:
    def law(factor: float) -> ForceFunction:
        def push(y: float, v: float) -> float:
            return factor * y

        return ForceFunction(force=push)

    documents = [
        json.loads(json.dumps(scene(-1.0, 1.0, law(factor)).document())) for factor in (1.0, 2.0)
    ]
    texts = [each["impact_pair"][0]["law"]["force"] for each in documents]
    assert texts[0].startswith(f"{__name__}.") and "push (" in texts[0]
    assert texts[0] != texts[1]
    assert digest_of(law(1.0)) == digest_of(law(1.0)) != digest_of(law(2.0))
    with pytest.raises(SceneError, match="'function' takes a function, which only Python can give"):
        scene_from(documents[0])


@pytest.mark.slow
def test_explain_says_what_flies_and_what_does_not() -> None:
    found = explain(scene(-1.0, 1.0, OWN))
    assert "function stop upper" in found.effects
    assert found.methods["simulate"] == "applies"


test_a_method_says_by_name_what_it_lacks = refusals(
    lambda method, law: method(scene(-1.0, 1.0, law)),
    (linearise, OWN, "law must be 'viscoelastic' where it has a damper, got 'function'"),
    (fokker_planck, OWN, "law.force must depend on the speed by a linear damper alone"),
    (linearise, ForceFunction(force=ball), "law.energy must be known, got none of kind"),
    (fokker_planck, ForceFunction(force=ball), "law.energy must be known, got none of kind"),
    error=NotApplicable,
)


def test_the_exact_law_needs_the_energy() -> None:
    model = model_of(scene(-1.0, 1.0, ForceFunction(force=ball)))
    assert [each for each in unmet_by_exact(model) if each.startswith("law.energy must be known")]
    assert unmet_by_exact(model_of(scene(-1.0, 1.0, BALL))) == []


def test_a_function_that_numba_does_not_compile_is_refused_in_a_sentence() -> None:
    law = ForceFunction(force=lambda y, v: float(np.interp(y, *{0: [0.0, 1.0]}.values(), [0, 1.0])))
    with pytest.raises(SceneError, match=r"must be a function that numba compiles, got "):
        simulate(scene(-1.0, 1.0, law), paths=8, duration=1.0)


test_a_function_that_is_no_force_is_refused = refusals(
    lambda force: ForceFunction(force=force),
    (lambda y: 1.0, "takes a deflection (m) and a speed (m/s)"),
    (lambda y, v: "hard", "returns a number, got ValueError"),
    (lambda y, v: -y, "not negative at rest, got -1e-09 at 1e-09 m"),
    (lambda y, v: float("nan"), "finite number"),
)


# ---- a law of the package is two files ----------------------------------------------------------

WRITTEN = '''
"""The contact of round bodies with a loss that grows with the speed."""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.numerics import Vector
from stochvi.scenes.impact_laws.compliant import CompliantLaw, inside
from stochvi.scenes.validation import NonNegative, Positive


class HuntCrossley(CompliantLaw):
    """F = coefficient y^exponent (1 + loss y')."""

    word: ClassVar[str] = "Hunt-Crossley"
    kind: Literal["hunt-crossley"] = "hunt-crossley"
    coefficient: Positive
    exponent: Positive
    loss: NonNegative

    @property
    def conservative(self) -> bool:
        return self.loss == 0.0

    def damping(self, mass: float) -> float:
        return 0.0

    def force_at(self, deflection: ArrayLike, rate: ArrayLike = 0.0, mass: float = 1.0) -> Vector:
        push = self.coefficient * inside(deflection) ** self.exponent
        return np.maximum(push * (1.0 + self.loss * np.asarray(rate)), 0.0)

    def per_unit_mass(self, mass: float) -> Self:
        return self.model_copy(update={"coefficient": self.coefficient / mass})

    def scaled(self, length: float, time: float) -> Self:
        factor = time**2 * length ** (self.exponent - 1.0)
        changed = {"coefficient": self.coefficient * factor, "loss": self.loss * length / time}
        return self.model_copy(update=changed)

    def strengths(self) -> tuple[float, ...]:
        return (self.coefficient, self.loss)

    def in_words(self) -> str:
        return f"{self.word}, coefficient {self.coefficient:.4g}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.hunt_crossley import HuntCrossley as Compiled

        return Compiled(self.coefficient, self.exponent, self.loss)
'''

FLIES = '''
"""The contact of round bodies with a loss that grows with the speed."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.parts import force, is_lossy, is_smooth, rate, read_law


class HuntCrossley(NamedTuple):
    coefficient: float
    exponent: float
    loss: float


@force.of(HuntCrossley)
def _(law, y, v):
    return law.coefficient * max(y, 0.0) ** law.exponent * (1.0 + law.loss * v)


@rate.of(HuntCrossley)
def _(law, y, v, push):
    k, n = law.coefficient, law.exponent
    energy = 0.5 * v * v + k / (n + 1.0) * max(y, 0.0) ** (n + 1.0)
    deepest = (2.0 * (n + 1.0) * energy / k) ** (1.0 / (n + 1.0))
    deepest = max(deepest, (2.0 * (n + 1.0) * max(push, 0.0) / k) ** (1.0 / n))
    return max(math.sqrt(n * k * deepest ** (n - 1.0)), law.loss * k * deepest**n)


@is_lossy.of(HuntCrossley)
def _(law):
    return law.loss > 0.0


@is_smooth.of(HuntCrossley)
def _(law):
    return False


@read_law.of(HuntCrossley)
def _(law, numbers, row):
    return HuntCrossley(numbers[row, 0], numbers[row, 1], numbers[row, 2])
'''

TRIED = """
import math
import sys

import numpy as np

from stochvi import ForceFunction, load_scene, simulate
from stochvi.methods.replay.march import SampledExcitation, integrate, rest_of
from stochvi.model.model import model_of

scene = load_scene(sys.argv[1])
written = scene.impact_pairs[0].law
assert written.kind == "hunt-crossley", written


def push(y, v):
    return 200.0 * y**1.4 * (1.0 + 0.3 * v)


pairs = [pair.replace(law=ForceFunction(force=push)) for pair in scene.impact_pairs]
own = scene.replace(impact_pairs=pairs)


def wrong(y, v):
    return 200.0 * y**1.4 * (1.0 + 1.5 * v)


lossy = scene.replace(
    impact_pairs=[pair.replace(law=ForceFunction(force=wrong)) for pair in scene.impact_pairs]
)


# The noise is the same, but sub-steps have other lengths, and impacts amplify that: a loss that is
# 1e-9 larger moves means by a tenth of an error in 200 s.
def apart(one, other):
    found = [
        abs(estimate.value - other.estimates()[key].value)
        / (math.sqrt(2.0) * max(estimate.standard_error, 1e-9))
        for key, estimate in one.estimates().items()
    ]
    return max(found)


one, other, control = (
    simulate(each, paths=256, duration=60.0, seed=1) for each in (scene, own, lossy)
)
assert apart(one, other) < 4.5, apart(one, other)
assert apart(one, control) > 4.5, apart(one, control)
model, count = model_of(scene), len(model_of(scene).coordinates)
forces = 8.0 * np.random.default_rng(1).normal(size=(400, count))
shaking = SampledExcitation(step=0.1, forces=forces, base=np.zeros(400))
one, other = (integrate(each, shaking, rest_of(each)) for each in (model, model_of(own)))
assert len(one.impacts) > 3
assert np.abs(one.displacement - other.displacement).max() < 1e-6
print("followed")
"""

LAW_OF_ONE = {"kind": "hunt-crossley", "coefficient": 200.0, "exponent": 1.4, "loss": 0.3}
SCENE_OF_ONE = to_toml(changed(["impact_pair", 0, "law"], LAW_OF_ONE))

SCENE_OF_SIX = """
[structure]
kind = "matrices"
coordinates = ["a", "b", "c", "d", "e", "f"]
mass = MASS
damping = DAMPING
stiffness = STIFFNESS
[[impact_pair]]
between = ["b", "c"]
lower = -0.7
upper = 0.7
law = { kind = "hunt-crossley", coefficient = 200.0, exponent = 1.4, loss = 0.3 }
[[excitation]]
kind = "white"
on = "c"
intensity = 0.5
"""


def chain() -> str:
    """Six masses on a row of springs."""
    stiffness = 2.0 * np.eye(6) - np.eye(6, k=1) - np.eye(6, k=-1)
    written = {"MASS": np.eye(6), "STIFFNESS": stiffness, "DAMPING": 0.1 * stiffness}
    text = SCENE_OF_SIX
    for name, matrix in written.items():
        text = text.replace(name, str(matrix.tolist()))
    return text


@pytest.mark.verify
@pytest.mark.parametrize("several", [False, True])
def test_a_law_of_the_package_is_two_files(tmp_path: Path, several: bool) -> None:
    """In a copy of the package; the same force as a function is the judge."""
    package = Path(stochvi.__file__).parent
    shutil.copytree(package, tmp_path / "stochvi")
    for room, text in (("scenes/impact_laws", WRITTEN), ("engine", FLIES)):
        (tmp_path / "stochvi" / room / "hunt_crossley.py").write_text(text, encoding="utf-8")
    (tmp_path / "tried.py").write_text(TRIED, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(chain() if several else SCENE_OF_ONE, encoding="utf-8")
    found = subprocess.run(
        [sys.executable, "tried.py", "scene.toml"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.stdout.endswith("followed\n"), found.stderr


# ------------------------------------------------------------------------------
# Drives that switch by the motion, with noise: a density, a twin of small steps, and formulas.
# ------------------------------------------------------------------------------


QUANTITIES = {"xx": "displacement_mean_square", "vv": "velocity_mean_square"}
SUMS = {"f1": "impact_speed_rate", "f2": "impact_speed_square_rate"}


def scene_of(twin: RelayTwin, intensity: float | None = None) -> Scene:
    """The scene of a twin."""
    law: Any = (
        Restitution(coefficient=twin.restitution)
        if twin.stop_stiffness is None
        else Elastic(stiffness=twin.stop_stiffness)
    )
    stops = {
        name: place
        for name, place in (("lower", twin.lower), ("upper", twin.upper))
        if math.isfinite(place)
    }
    places = {
        name: place
        for name, place in (("reverses_above", twin.above), ("reverses_below", twin.below))
        if math.isfinite(place)
    }
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=twin.damping, stiffness=twin.frequency**2,
            damper=Relay(force=twin.force, delay=twin.delay, **places),
        ),
        impact_pairs=[ImpactPair(**stops, law=law)],
        excitations=[WhiteNoise(intensity=twin.intensity if intensity is None else intensity)],
    )  # fmt: skip


def told(found: Response) -> dict[str, Estimate]:
    x, pair = found.coordinates["x"], found.impact_pairs["stops"]
    known = {name: x[each] for name, each in QUANTITIES.items()}
    return known | {name: pair[each] for name, each in SUMS.items()}


def agree(found: Response, known: dict[str, tuple[float, float]]) -> list[bool]:
    """Whether each quantity agrees with that of the twin within both errors."""
    agreed = []
    for name, estimate in told(found).items():
        value, error = known[name]
        both = Estimate(
            value=estimate.value, standard_error=math.hypot(estimate.standard_error, error),
            # the twin has steps of 4e-4 s, over flights of a second
            bias=(estimate.bias or 0.0) + 2e-3 * value, bias_error=estimate.bias_error,
        )  # fmt: skip
        agreed.append(abs(both.value - value) <= both.reach(4.5))
    return agreed


BETWEEN = RelayTwin(
    force=1.0, damping=0.2, frequency=1.0, intensity=0.05, lower=-1.0, upper=1.0, restitution=0.6
)
STRIKER = RelayTwin(
    force=10.0, damping=1.0, frequency=0.03, intensity=0.5, lower=0.0, restitution=0.5, above=0.43
)
TWINS = {
    "striker": STRIKER,
    "late striker": RelayTwin(**{**vars(STRIKER), "delay": 0.03}),
    "late between stops": RelayTwin(**{**vars(BETWEEN), "delay": 0.05}),
    "late on a compliant stop": RelayTwin(
        **{**vars(STRIKER), "delay": 0.03, "damping": 1.5, "stop_stiffness": 2e4}
    ),
    "reversed on both sides": RelayTwin(
        **{**vars(BETWEEN), "above": 0.4, "below": -0.5, "force": 3.0}
    ),
}


@pytest.mark.slow
@quick_cases("name", list(TWINS), keep=(1, 3))
def test_simulation_has_the_motion_of_a_relay_that_sees_the_past(name: str) -> None:
    twin = TWINS[name]
    found = simulate(scene_of(twin), paths=64, duration=60.0, seed=3)
    assert all(agree(found, twin.averages(64, 10.0, 60.0, 4e-4)))
    # the control: a relay of no delay, or a force that is larger by a twentieth
    changed = {"delay": 0.0} if twin.delay else {"force": 1.05 * twin.force}
    other = RelayTwin(**{**vars(twin), **changed})
    assert not all(agree(found, other.averages(64, 10.0, 60.0, 4e-4)))


def test_a_relay_between_stops_has_the_density_of_fokker_and_planck() -> None:
    scene = scene_of(BETWEEN)
    known = told(fokker_planck(scene))
    found = simulate(scene, paths=128, duration=100.0, seed=1)
    for name, estimate in told(found).items():
        assert_agrees(estimate, known[name].value)
    assert_agrees(found.identities["energy"], 0.0)


@pytest.mark.parametrize("restitution", [0.1, 0.3])
def test_rates_have_a_bias_where_no_impact_can_be_slow(restitution: float) -> None:
    twin = RelayTwin(**{**vars(BETWEEN), "restitution": restitution})
    keys = {"speed_threshold": 0.02}
    known = fokker_planck(scene_of(twin), **keys).impact_pairs["stops"]
    weaker = RelayTwin(**{**vars(twin), "force": 0.85 * twin.force})
    wrong = fokker_planck(scene_of(weaker), **keys).impact_pairs["stops"]
    found = simulate(scene_of(twin), paths=128, duration=100.0, seed=1, **keys)
    for name in ("collision_rate", "impact_speed_mean"):
        estimate = found.impact_pairs["stops"][name]
        assert estimate.bias is not None
        assert_agrees(estimate, known[name].value)
        assert_differs(estimate, wrong[name].value)
    assert not any("not resolved" in each for each in found.warnings)


@pytest.mark.parametrize(("intensity", "restitution"), [(20.0, 0.4), (0.5, 0.0)])
def test_rates_have_no_bias_where_impacts_may_be_slow(intensity: float, restitution: float) -> None:
    """Strong noise throws a striker back to its stop; without rebound it stays there."""
    twin = RelayTwin(**{**vars(STRIKER), "intensity": intensity, "restitution": restitution})
    found = simulate(scene_of(twin), paths=64, duration=20.0, seed=3)
    assert found.impact_pairs["stops"]["collision_rate"].bias is None


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.3, 0.4])
def test_the_stated_bias_holds_that_of_the_step(restitution: float) -> None:
    twin = RelayTwin(**{**vars(STRIKER), "restitution": restitution})
    found = simulate(scene_of(twin), paths=128, duration=60.0, seed=3)
    rate = found.impact_pairs["stops"]["collision_rate"]
    plan = make_plan(model_of(scene_of(twin)), duration=60.0)
    finer = plan.with_step(plan.step / 8.0)
    rows = dict(zip(finer.layout.rows, finer.averages(4, 0, 128), strict=True))
    counted = rows["stops", "n_lower"]
    error = math.hypot(rate.standard_error, float(counted.std()) / math.sqrt(128))
    assert rate.bias is not None
    assert abs(rate.value - float(counted.mean())) < rate.bias + 4.5 * error


def test_in_weak_noise_it_is_the_motion_without_noise() -> None:
    drive = RelayBetweenStops(
        force=1.0, clearance=1.0, restitution=0.6, damping_rate=0.2, frequency=1.0
    )
    found = told(simulate(scene_of(BETWEEN, 1e-4), paths=32, duration=100.0, seed=2))
    for name, power in (("f1", 1), ("f2", 2)):
        wanted = 2.0 * drive.impact_speed**power / drive.period
        # an impact more or less in 100 s, as all paths move alike
        assert found[name].value == pytest.approx(
            wanted, abs=found[name].reach(4.5) + 0.006 * wanted
        )
    plain = 2.0 * math.sqrt(1.0 / (1.0 - 0.6**2))  # the control: without the damper
    assert abs(plain / drive.impact_speed - 1.0) > 0.05


def thrown(damping: float) -> float:
    """Speed of the impacts in the long run of a striker with a damper, by an integrator with
    events."""
    speed = 4.0
    for _ in range(25):
        state = [0.0, 0.5 * speed]
        for side, reaches in ((1.0, 0.43), (-1.0, 0.0)):

            def there(t: float, y: np.ndarray, reaches: float = reaches) -> float:
                return y[0] - reaches

            there.terminal, there.direction = True, side
            solved = solve_ivp(
                lambda t, y, side=side: [y[1], 10.0 * side - damping * y[1]], (0.0, 10.0), state,
                events=there, rtol=1e-9, atol=1e-11,
            )  # fmt: skip
            state = solved.y[:, -1].tolist()
        speed = -state[1]
    return speed


@pytest.mark.slow
def test_in_weak_noise_a_striker_is_that_of_the_formula() -> None:
    """By an integrator, which has the speed of the formula without a damper."""
    drive = SwitchedDrive(restitution=0.5, force=10.0, switching=0.43)
    assert thrown(0.0) == pytest.approx(drive.impact_speed, rel=1e-6)
    found = told(simulate(scene_of(STRIKER, 1e-3), paths=16, duration=60.0, seed=2))
    assert found["f2"].value / found["f1"].value == pytest.approx(thrown(1.0), rel=3e-3)
    assert abs(thrown(1.0) / drive.impact_speed - 1.0) > 0.1  # the control: the damper matters


@pytest.mark.slow
def test_what_a_relay_is_and_who_refuses_it() -> None:
    late = scene_of(TWINS["late striker"])
    found = explain(late)
    assert "drive by a relay with a delay" in found.effects
    assert found.methods["simulate"] == "applies"
    with pytest.raises(NotApplicable, match="got hysteresis of kind 'relay'"):
        fokker_planck(late)
    with pytest.raises(
        NotApplicable, match="must switch by the velocity, got a relay that is late"
    ):
        linearise(late)
    with pytest.raises(SceneError, match="needs reverses_below under reverses_above"):
        Relay(force=1.0, reverses_above=0.1, reverses_below=0.2)


# ------------------------------------------------------------------------------
# Dampers that bring energy to slow motions, between stops: densities judge simulations.
# ------------------------------------------------------------------------------


QUANTITIES_OF_SELF_EXCITED = (
    "displacement_mean",
    "displacement_mean_square",
    "velocity_mean_square",
)
RATES = ("collision_rate", "impact_speed_rate", "impact_speed_square_rate")


def scene_of_of_self_excited(number: int, share: float = 1.0) -> Scene:
    """A random scene of unit mass and frequency; `share` is that of the negative damping."""
    generator = np.random.default_rng(number)
    linear, cubic = generator.uniform(0.05, 0.4), generator.uniform(0.1, 1.0)
    speed = math.sqrt(4.0 * linear / (3.0 * cubic))  # of the motion without stops
    lower, upper = -speed * generator.uniform(0.2, 1.2), speed * generator.uniform(0.2, 1.2)
    return Scene(
        structure=Oscillator(
            mass=1.0, damping=0.0, stiffness=1.0,
            damper=Rayleigh(linear_damping=-share * linear, cubic_damping=cubic),
        ),
        impact_pairs=[
            ImpactPair(
                lower=lower, upper=upper,
                law=Restitution(coefficient=float(generator.uniform(0.5, 0.95))),
            )
        ],
        excitations=[WhiteNoise(intensity=float(speed**2 * generator.uniform(0.02, 0.2)))],
    )  # fmt: skip


def away(scene: Scene, judged: Scene, number: int) -> list[Estimate]:
    """Simulated less calculated quantities, with the errors of both."""
    known = fokker_planck(judged)
    found = simulate(scene, paths=256, duration=150.0, seed=number)
    names = [("coordinates", "x", name) for name in QUANTITIES_OF_SELF_EXCITED]
    names += [("impact_pairs", "stops", name) for name in RATES]
    pairs = [
        [getattr(each, kind)[owner][name] for each in (found, known)] for kind, owner, name in names
    ]
    return [
        Estimate(
            value=one.value - other.value, standard_error=one.standard_error,
            bias=(one.bias or 0.0) + (other.bias or 0.0), bias_error=one.bias_error,
        )
        for one, other in pairs
    ]  # fmt: skip


@quick_cases("number", range(50), keep={3, 17})
def test_rayleigh_damping_between_stops_has_the_density_of_fokker_and_planck(number: int) -> None:
    scene = scene_of_of_self_excited(number)
    for difference in away(scene, scene, number):
        assert_agrees(difference, 0.0)


def test_less_negative_damping_is_noticed() -> None:
    """The negative control: a tenth less than in the scene that judges."""
    judged = [
        abs(difference.value) <= difference.reach(4.5)
        for difference in away(scene_of_of_self_excited(3, 0.9), scene_of_of_self_excited(3), 3)
    ]
    assert not all(judged)


# ------------------------------------------------------------------------------
# A restitution that scatters in the methods without chance, and what the others say of it.
# ------------------------------------------------------------------------------


def scene_of_of_scatter(coefficient: Any, *, damping: float = 0.1, gap: float = 1.0) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap, law=Restitution(coefficient=coefficient))],
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


# ---- slow impacts ------------------------------------------------------------------------------


@pytest.mark.parametrize(("mean", "std"), [(0.5, 0.25), (0.7, 0.2)])
def test_slow_impacts_have_the_exponent_of_the_mean_power(mean: float, std: float) -> None:
    """E R^(beta - 2) = 2 sin((1 + 2 beta) pi / 6), read off the density by Fokker-Planck."""
    scene = scene_of_of_scatter({"mean": mean, "std": std})
    exponent = fokker_planck_density(scene, rtol=1e-6).slow_impact_exponent("upper")
    assert_agrees(exponent, corner_exponent(equivalent_restitution(BetaDistribution(mean, std))))
    # neither the mean restitution nor that of the same energy has it
    for other in (mean, math.hypot(mean, std)):
        assert_differs(exponent, corner_exponent(other))


def test_the_equivalent_restitution_lies_between_power_means() -> None:
    """That of R^-2 and the geometric one, which it is where the rate of impacts becomes infinite;
    R itself without scatter."""
    for mean, std in ((0.7, 0.1), (0.5, 0.25), (0.3, 0.1), (0.9, 0.2)):
        law = BetaDistribution(mean, std)
        equivalent = equivalent_restitution(law)
        assert law.moment(-2.0) ** -0.5 < equivalent < math.exp(law.mean_logarithm) < mean

    def away(std: float) -> float:
        return BetaDistribution(0.2, std).mean_logarithm - math.log(COLLAPSE_RESTITUTION)

    at_collapse = float(brentq(away, 0.05, 0.2))
    for share in (0.98, 1.02):
        law = BetaDistribution(0.2, share * at_collapse)
        equivalent = equivalent_restitution(law)
        assert equivalent == pytest.approx(math.exp(law.mean_logarithm), rel=2e-3)
        assert (equivalent > COLLAPSE_RESTITUTION) == (share < 1.0)
    for mean in (0.1, 0.5, 0.99):
        assert equivalent_restitution(BetaDistribution(mean, 1e-6)) == pytest.approx(mean, rel=1e-6)


def test_collapse_is_told_by_the_geometric_mean() -> None:
    """At a mean of 0.22, where a constant restitution would not bring the mass to rest."""
    law = {"mean": 0.22, "std": 0.17}
    assert Restitution(coefficient=law).slow_restitution < COLLAPSE_RESTITUTION < 0.22
    for method in (fokker_planck, lambda scene: simulate(scene, paths=64, duration=20.0)):
        told = " ".join(method(scene_of_of_scatter(law)).warnings)
        assert "as it scatters" in told and "infinit" in told
    assert "infinit" not in " ".join(fokker_planck(scene_of_of_scatter(0.22)).warnings)


# ---- the other methods ---------------------------------------------------------------------------


def test_the_density_in_time_ends_in_the_stationary_one() -> None:
    scene = scene_of_of_scatter({"mean": 0.5, "std": 0.25})
    late, known = transient(scene, times=[120.0]).to_frame().iloc[-1], values(fokker_planck(scene))
    plain = values(fokker_planck(scene_of_of_scatter(0.5)))
    for column, name, power in (
        ("variance", "displacement_std", 2), ("velocity_mean_square", "velocity_std", 2),
    ):  # fmt: skip
        bias = late[f"{column}_bias"] + 1e-4
        assert late[column] == pytest.approx(known[name] ** power, abs=bias)
        assert late[column] != pytest.approx(plain[name] ** power, abs=bias)


@pytest.mark.parametrize("variant", ["finite jumps", "continuous"])
def test_averaging_tends_to_fokker_planck_at_light_damping(variant: str) -> None:
    """Losses of 1 - E R^2 = 0.018, of which the scatter takes back a sixth."""
    scene = scene_of_of_scatter({"mean": 0.99, "std": 0.006}, damping=0.005)
    known, found = values(fokker_planck(scene, rtol=1e-5)), values(average(scene, variant=variant))
    for name in ("velocity_std", "impact_speed_rate", "impact_speed_square_rate"):
        assert found[name] == pytest.approx(known[name], rel=0.02)


def test_averaging_takes_the_mean_of_finite_jumps() -> None:
    """Nearer to Fokker-Planck than the average of a constant restitution of the same energy."""
    law = {"mean": 0.6, "std": 0.4}
    known = values(fokker_planck(scene_of_of_scatter(law, damping=0.02)))
    own = values(average(scene_of_of_scatter(law, damping=0.02)))
    same_energy = values(average(scene_of_of_scatter(math.hypot(0.6, 0.4), damping=0.02)))
    for name in ("velocity_std", "impact_speed_square_rate"):
        assert abs(own[name] - known[name]) < abs(same_energy[name] - known[name])


@pytest.mark.parametrize("form", ["closure", "motion", "force", "clumps"])
def test_linearisation_balances_energy_with_the_mean_square(form: str) -> None:
    """b E v^2 + (1 - E R^2) F2 / 2 = S0 / 2, which holds in no form without the scatter."""
    law = Restitution(coefficient={"mean": 0.5, "std": 0.3})
    found = values(linearise(scene_of_of_scatter(law.coefficient), form=form))
    power = 0.1 * found["velocity_std"] ** 2
    square = found["impact_speed_square_rate"]
    lost = (1.0 - law.restitution_mean_square) / 2.0 * square
    assert power + lost == pytest.approx(0.1, rel=1e-6)
    assert power + (1.0 - 0.5**2) / 2.0 * square != pytest.approx(0.1, rel=1e-2)


def test_the_closure_errs_as_it_does_without_scatter() -> None:
    for law in (0.5, {"mean": 0.5, "std": 0.25}):
        known, found = (
            values(method(scene_of_of_scatter(law))) for method in (fokker_planck, linearise)
        )
        for name in ("displacement_std", "velocity_std"):
            assert found[name] == pytest.approx(known[name], rel=0.04)


def test_no_error_is_taken_from_the_atlas_of_constant_restitutions() -> None:
    for method in (linearise, average):
        constant, scattered = (
            method(scene_of_of_scatter(law)) for law in (0.7, {"mean": 0.7, "std": 0.1})
        )
        assert constant.coordinates["x"]["velocity_std"].bias is not None
        assert scattered.coordinates["x"]["velocity_std"].bias is None


test_methods_that_cannot_follow_it_say_so = refusals(
    lambda method: method(scene_of_of_scatter({"mean": 0.7, "std": 0.1})),
    (exact, "restitution must be 1 (an elastic stop), got 0.7 ± 0.1"),
    (lambda scene: harmonic_response(sine(scene)), "which scatters; give its mean alone"),
    (lambda scene: perturbations(sine(scene), [1.0]), "which scatters; give its mean alone"),
    error=NotApplicable,
)


def sine(scene: Scene) -> Scene:
    return scene.replace(
        excitations=[Sine(amplitude=1.0, frequency_hz=0.2), ConstantLoad(force=0.0)]
    )


def test_explain_and_the_assumptions_name_the_draw() -> None:
    scene = scene_of_of_scatter({"mean": 0.7, "std": 0.1})
    assert any("drawn at each impact" in effect for effect in explain(scene).effects)
    assert any("beta distribution" in each for each in scene.assumptions())
    assert not any("beta distribution" in each for each in scene_of_of_scatter(0.7).assumptions())


# ------------------------------------------------------------------------------
# A restitution that depends on the speed: in simulation, replay, Fokker-Planck and elsewhere.
# ------------------------------------------------------------------------------


LAWS: dict[str, dict[str, Any]] = {
    "viscoelastic": {"coefficient": 0.6, "at_speed": 0.5, "body": "viscoelastic"},
    "hunt-crossley": {"coefficient": 0.7, "at_speed": 0.6, "body": "hunt-crossley"},
    "yielding": {"coefficient": 0.6, "at_speed": 0.8, "body": "yielding"},
    "power": {"coefficient": 0.8, "at_speed": 0.5, "body": "power", "exponent": -0.3},
    "list": {"speed": [0.1, 0.5, 2.0], "coefficient": [0.95, 0.7, 0.3]},
}
JUDGED = ("displacement_std", "velocity_std", "impact_speed_rate", "impact_speed_square_rate")


def law_of(name: str, **changes: Any) -> SpeedRestitution:
    return SpeedRestitution(**{**LAWS[name], **changes})


def scene_of_of_speeds(
    law: Any, *, gap: float = 0.6, upper: float | None = None, load: float = 0.0
) -> Scene:
    pushed = [ConstantLoad(force=load)] if load else []
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(lower=-gap, upper=gap if upper is None else upper, law=law)],
        excitations=[WhiteNoise(intensity=0.2), *pushed],
    )


def assert_alike(found: Response, judge: Response, pair: str = "stops") -> None:
    """The judged quantities of a simulation agree with those of a judge, exact to 1e-4."""
    one = {**found.coordinates["x"], **found.impact_pairs[pair]}
    other = {**judge.coordinates["x"], **judge.impact_pairs["stops"]}
    for name in JUDGED:
        assert_agrees(one[name], other[name].value)


# ---- the law -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_the_engine_has_the_restitution_of_the_law(name: str) -> None:
    law = law_of(name)
    compiled = law.compiled()
    assert is_rigid(compiled)
    speeds = np.geomspace(1e-5, 90.0, 400)
    found = np.array([rebound(compiled, w, 0.5) / w for w in speeds])
    wanted = law.restitution_at(speeds)
    # a kink of the body that yields lies within a cell of the table
    error = 3e-3 if name == "yielding" else 1e-4
    assert found == pytest.approx(wanted, abs=error)
    assert np.ptp(wanted) > 100.0 * 1e-4  # the control: the speed matters
    table, numbers = functions_of([compiled]), row_of_numbers(compiled)[None]
    for w in (0.05, 0.7, 3.0):
        back = rebound_of(table, 0, numbers, 0, w, uniform_of(np.uint64(1), 0))
        assert back == pytest.approx(w * float(law.restitution_at(w)), abs=error * w)
    assert mean_rebound_of(table, 0, numbers, 0, 1.0) == pytest.approx(
        float(law.restitution_at(1e-6)), rel=1e-12
    )


def test_bodies_have_the_restitution_of_their_formulas() -> None:
    yields = law_of("yielding")
    start = 0.8 * 0.6**4  # the speed w_y
    assert yields.restitution_at([0.9 * start, 16.0 * start]) == pytest.approx([1.0, 0.5])
    soft = law_of("viscoelastic")
    # slow impacts lose with w^(1/5)
    lost = 1.0 - soft.restitution_at(np.array([1e-9, 1e-8]))
    assert lost[1] / lost[0] == pytest.approx(10.0**0.2, rel=0.02)
    wet = law_of("hunt-crossley")
    lost = 1.0 - wet.restitution_at(np.array([1e-4, 2e-4]))
    assert lost[1] / lost[0] == pytest.approx(2.0, rel=1e-3)
    assert law_of("power").restitution_at([1e-3, 0.5, 5.0]) == pytest.approx(
        [1.0, 0.8, 0.8 * 10.0**-0.3]
    )
    assert law_of("viscoelastic", coefficient=1.0).conservative


test_what_is_wrong_is_said_in_a_sentence = refusals(
    SpeedRestitution,
    ({"coefficient": 0.5}, "needs body where coefficient is one number"),
    ({"coefficient": [0.5, 0.4]}, "needs speed where coefficient is a list"),
    ({"coefficient": [0.5, 0.4], "speed": [1.0]}, "as many entries .* got 2 and 1"),
    ({"coefficient": [0.5, 0.4], "speed": [2.0, 1.0]}, "increasing speed, got 1 after 2"),
    ({"coefficient": [0.5, 1.4], "speed": [1.0, 2.0]}, r"in \[0, 1\], got 1.4"),
    ({"coefficient": 1.5, "body": "yielding"}, r"in \[0.01, 1\] with a body, got 1.5"),
    ({"coefficient": 0.5, "body": "power"}, "needs exponent with body = 'power'"),
    ({"coefficient": 0.5, "body": "stone"}, "body must be 'viscoelastic'"),
    ({"coefficient": lambda w: 0.5, "body": "power"}, "takes no body .* is a function"),
    pattern=True,
)


# ---- methods that follow it ----------------------------------------------------------------------


def random_cases(count: int) -> list[tuple[SpeedRestitution, dict[str, float]]]:
    rng, found = np.random.default_rng(34), []
    for number in range(count):
        name = list(LAWS)[number % len(LAWS)]
        if name == "list":
            top = float(rng.uniform(0.7, 1.0))
            law = law_of(name, coefficient=[top, 0.8 * top, float(rng.uniform(0.3, 0.6)) * top])
        else:
            law = law_of(name, coefficient=float(rng.uniform(0.45, 0.95)))
        keys = {"gap": float(rng.uniform(0.3, 1.2)), "upper": float(rng.uniform(0.1, 1.2))}
        found.append((law, keys))
    return found


@quick_cases(("law", "keys"), random_cases(20), keep=(0, 2, 3, 4))
def test_simulation_has_the_density_of_fokker_and_planck(
    law: SpeedRestitution, keys: dict[str, float]
) -> None:
    scene = scene_of_of_speeds(law, **keys)
    judge = fokker_planck(scene, rtol=1e-4)
    found, known = simulate(scene, rel_error=0.01, seed=7), values(judge)
    assert_alike(found, judge)
    for balance in ("energy", "virial", "force"):
        assert_agrees(found.identities[balance], 0.0)
    # the control: the restitution at one speed for all
    constant = values(
        fokker_planck(scene_of_of_speeds(Restitution(coefficient=law.restitution), **keys))
    )
    worst = max(abs(constant[name] / known[name] - 1.0) for name in JUDGED)
    assert worst > 0.01


def test_the_loss_in_the_balance_is_that_of_each_speed() -> None:
    """With the loss of one restitution for all speeds the balance of energy would fail."""
    scene = scene_of_of_speeds(law_of("list"))
    found = simulate(scene, rel_error=0.01, seed=3)
    assert_agrees(found.identities["energy"], 0.0)
    pair, speed = found.impact_pairs["stops"], found.coordinates["x"]["velocity_mean_square"]
    constant = (1.0 - 0.7**2) / 2.0 * pair["impact_speed_square_rate"].value
    assert abs(0.1 - 0.1 * speed.value - constant) > 0.05 * 0.1


@pytest.mark.slow
def test_a_structure_follows_it_as_one_mass_does() -> None:
    """The oscillator beside another one that it does not know, under a law for each stop; beside a
    compliant stop impacts between contacts are summed as well."""
    law = law_of("viscoelastic")
    known = fokker_planck(scene_of_of_speeds(law), rtol=1e-4)
    other = ImpactPair(on="z", clearance=0.3, law=Elastic(stiffness=50.0))
    scene = Scene(
        structure=Matrices(
            coordinates=["x", "z"], mass=[[1.0, 0.0], [0.0, 1.0]],
            damping=[[0.1, 0.0], [0.0, 0.1]], stiffness=[[1.0, 0.0], [0.0, 2.0]],
        ),
        impact_pairs=[ImpactPair(on="x", name="own", clearance=0.6, law=law), other],
        excitations=[WhiteNoise(intensity=0.2, on=name) for name in ("x", "z")],
    )  # fmt: skip
    found = simulate(scene, rel_error=0.01, seed=5)
    assert_alike(found, known, "own")
    assert_agrees(found.identities["energy"], 0.0)
    assert_agrees(found.identities["force on x"], 0.0)


def test_a_mass_that_is_pressed_onto_its_stop_rests_there() -> None:
    scene = scene_of_of_speeds(law_of("list"), gap=2.0, upper=0.1, load=0.6)
    found = simulate(scene, rel_error=0.01, seed=5)
    assert_alike(found, fokker_planck(scene, rtol=1e-4))
    assert_agrees(found.identities["force"], 0.0)


def test_a_replay_loses_at_each_impact_what_its_speed_says(tmp_path: Path) -> None:
    """A mass that falls onto its stop again and again: w' = R(w) w."""
    np.savetxt(tmp_path / "rest.txt", np.where(np.arange(20000) < 20, 60.0, 0.0))
    law = law_of("list")
    scene = Scene(
        structure=Isolator(frequency_hz=0.02, zeta=0.0, mass=1.0),
        impact_pairs=[ImpactPair(lower=-5.0, upper=0.0, law=law)],
        excitations=[
            RecordedNoise(file=str(tmp_path / "rest.txt"), unit="m/s2", fs=1000.0),
            ConstantLoad(acceleration=-2.0),
        ],
    )
    speeds = np.abs(replay(scene).impacts["speed"].to_numpy())
    speeds = speeds[speeds > 1e-2]
    assert len(speeds) > 4
    assert speeds[1:] == pytest.approx(law.restitution_at(speeds[:-1]) * speeds[:-1], rel=2e-3)
    assert np.ptp(speeds[1:] / speeds[:-1]) > 0.1  # the control: no constant restitution


# ---- those that refuse it, and files -------------------------------------------------------------


@pytest.mark.parametrize("method", [exact, linearise])
def test_methods_for_a_number_refuse_it_by_name(method: Any) -> None:
    with pytest.raises(NotApplicable, match="got a function of speed at the lower stop"):
        method(scene_of_of_speeds(law_of("list")))


def test_a_scene_file_holds_every_form(tmp_path: Path) -> None:
    lines = [
        'law = { kind = "speed-restitution", coefficient = 0.8, at_speed = 0.5, '
        'body = "viscoelastic" }',
        'law = { kind = "speed-restitution", speed = [0.1, 2.0], coefficient = [0.9, 0.5] }',
    ]
    for line in lines:
        (tmp_path / "a.toml").write_text(
            '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
            f'[[impact_pair]]\nclearance = 0.6\n{line}\n[[excitation]]\nkind = "white"\n'
            "intensity = 0.2\n"
        )
        scene = load_scene(tmp_path / "a.toml")
        found = explain(scene)
        assert found.methods["simulate"] == found.methods["fokker-planck"] == "applies"
        assert "rigid stop upper, restitution by speed" in found.effects
        assert "restitution depends on the speed of the impact alone" in scene.assumptions()


def test_the_line_of_a_test_is_a_law_of_a_scene(tmp_path: Path) -> None:
    """The numbers of the line give the restitutions of the law that the test shows."""
    speeds = np.geomspace(0.05, 2.5, 14)
    rebounds = viscoelastic_restitution(0.2 * speeds**0.2) * speeds
    noise = 1.0 + 2e-3 * np.random.default_rng(2).standard_normal(14)
    found = identify(Rebounds(approach=speeds, rebound=rebounds * noise), at_speed=0.5)
    assert found.chosen == "viscoelastic body"
    (tmp_path / "a.toml").write_text(
        '[structure]\nkind = "oscillator"\nmass = 1.0\ndamping = 0.1\nstiffness = 1.0\n'
        f'[[impact_pair]]\nclearance = 0.6\n{found.line}\n[[excitation]]\nkind = "white"\n'
        "intensity = 0.2\n"
    )
    law = load_scene(tmp_path / "a.toml").impact_pairs[0].law
    assert isinstance(law, SpeedRestitution)
    wanted = viscoelastic_restitution(0.2 * speeds**0.2)
    assert law.restitution_at(speeds) == pytest.approx(wanted, abs=3e-3)
    assert found.law.restitution_at(speeds) == pytest.approx(wanted, abs=3e-3)
    constant = found.law.restitution_at([0.5])
    assert np.abs(constant - wanted).max() > 0.03  # the control


def test_fast_impacts_of_missions_know_the_law() -> None:
    """The probability of an impact above a speed in a time that is too short for two of them: their
    rate times it, by Fokker-Planck."""
    scene = scene_of_of_speeds(law_of("list"), gap=0.4)
    found = reliability(scene, mission=0.2, impact_speed=0.9, rel_error=0.03, seed=2)
    chance = found.chances["impact_speed"].estimate
    judged = [
        fokker_planck(each, rtol=1e-4, speed_threshold=0.9).impact_pairs["stops"]["collision_rate"]
        for each in (scene, scene_of_of_speeds(Restitution(coefficient=0.7), gap=0.4))
    ]
    known, constant = (each.value * 0.2 for each in judged)
    assert_agrees(chance, known)
    assert abs(constant / known - 1.0) > 0.2


# ------------------------------------------------------------------------------
# Absolute acceleration of what hits stops, by the methods that simulate nothing.
# ------------------------------------------------------------------------------


def mount(restitution: float, zeta: float = 0.1, reach: float = 1.0) -> Scene:
    """An isolator on white noise between rigid stops at so many standard deviations."""
    free = Scene(
        structure=Isolator(frequency_hz=1.0, zeta=zeta),
        excitations=[WhiteNoise(density=0.1, unit="g2/Hz")],
    )
    place = reach * exact(free).coordinates["x"]["displacement_std"].value
    law = Restitution(coefficient=restitution)
    pair = ImpactPair(lower=-place, upper=1.3 * place, law=law)
    return free.model_copy(update={"impact_pairs": (pair,)})


def simulated_of_stops(scene: Scene, paths: int = 64) -> Estimate:
    """The rms of the absolute acceleration about its mean, of springs and dampers along paths."""
    plan = plan_modal(model_of(scene), None, None)
    rows = plan.layout.rows
    mean, square = (plan.averages(3, 0, paths)[rows.index(("x", name))] for name in ("a", "aa"))
    variance = square - mean.mean() ** 2
    value = math.sqrt(variance.mean())
    error = float(variance.std(ddof=1)) / math.sqrt(paths) / (2.0 * value)
    return Estimate(value=value, standard_error=error, bias=0.0)


def acceleration(found: Response) -> Estimate:
    known = found.coordinates["x"]["acceleration_std"]
    assert isinstance(known, Estimate)
    return known


def test_between_impacts_it_is_that_of_springs_and_dampers_along_paths() -> None:
    for restitution, method in ((1.0, exact), (0.7, fokker_planck)):
        scene = mount(restitution)
        found = method(scene)
        known = simulated_of_stops(scene)
        assert_agrees(known, acceleration(found).value)
        assert_differs(simulated_of_stops(mount(restitution, reach=2.0)), acceleration(found).value)
        assert any("between impacts" in text for text in found.assumptions)


def test_far_stops_leave_it_as_it_is() -> None:
    scene = mount(0.9, zeta=0.02, reach=9.0)
    free = acceleration(exact(scene.model_copy(update={"impact_pairs": ()})))
    for found in (average(scene), linearise(scene), linearise(scene, form="motion")):
        assert acceleration(found).value == pytest.approx(free.value, rel=1e-3)


def test_soft_stops_without_room_are_springs_of_a_linear_structure() -> None:
    stiffness = np.array([[3.0, -1.0], [-1.0, 2.0]])

    def structure(added: float) -> Matrices:
        rows = (stiffness + np.diag([added, 0.0])).tolist()
        return Matrices(
            coordinates=("x", "z"), mass=diagonal(1, 1), damping=diagonal(0.1, 0.2), stiffness=rows
        )

    excitations = [WhiteNoise(intensity=0.2, on="base")]
    pair = ImpactPair(name="x", on="x", clearance=1e-7, law=Elastic(stiffness=4.0))
    soft = linearise(Scene(structure=structure(0.0), impact_pairs=[pair], excitations=excitations))
    linear = exact(Scene(structure=structure(4.0), excitations=excitations))
    without = exact(Scene(structure=structure(0.0), excitations=excitations))
    known = acceleration(linear).value
    assert acceleration(soft).value == pytest.approx(known, rel=1e-3)
    assert acceleration(without).value != pytest.approx(known, rel=0.05)


def test_it_is_absent_where_noise_shakes_the_mass_itself() -> None:
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[ImpactPair(clearance=1.0, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=0.2)],
    )
    assert exact(scene).coordinates["x"].acceleration_std is None


# ------------------------------------------------------------------------------
# Compiling takes nothing from a budget.
# ------------------------------------------------------------------------------


def test_a_deadline_waits_while_numba_compiles_and_not_while_compiled_code_runs() -> None:
    leave_out_of_budgets()
    leave_out_of_budgets()  # of every room that has kernels: it counts once

    @numba.njit
    def twice(x: float) -> float:
        return 2.0 * x

    before, deadline = stood_still(), Deadline.after(60.0)
    twice(1.0)
    compiling = stood_still() - before
    assert compiling > 1e-3 and deadline.due - deadline.moment == compiling
    twice(2.0)
    assert stood_still() - before == compiling


def test_ctrl_c_ends_compiling_and_the_function_can_be_compiled_later() -> None:
    """It used to be heard after minutes."""
    leave_out_of_budgets()

    @numba.njit
    def thrice(x: float) -> float:
        return 3.0 * x

    before = stood_still()
    with graceful_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="while kernels were compiled"):
            thrice(1.0)
    assert thrice(1.0) == 3.0 and stood_still() > before
    compiled = stood_still()
    assert stood_still() == compiled  # the clock goes on


def test_compiling_is_announced_where_it_takes_time(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[float, str]] = []
    monkeypatch.setattr(workers, "ANNOUNCED_SECONDS", 0.0)
    with showing(lambda done, text: said.append((done, text))) as show:
        assert show is not None
        show(0.25, "on the way")
        with outside_budgets():
            for _ in range(10**7):
                if len(said) > 1:
                    break
    assert said[1] == (0.25, "compiling, once on each machine")
    monkeypatch.setattr(workers, "ANNOUNCED_SECONDS", 60.0)
    with showing(lambda done, text: said.append((done, text))), outside_budgets():
        pass  # kept code is there at once
    assert len(said) == 2
