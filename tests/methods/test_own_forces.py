"""Forces of stops that are functions of a user's own: followed, told, refused."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import stochvi
from stochvi import (
    ForceFunction,
    Hertz,
    ImpactPair,
    NotApplicable,
    Oscillator,
    Scene,
    SceneError,
    WhiteNoise,
    exact,
    explain,
    fokker_planck,
    linearise,
    simulate,
)
from stochvi.methods.closed_form import unmet as unmet_by_exact
from stochvi.methods.replay.march import SampledExcitation, integrate, rest_of
from stochvi.model.model import model_of
from stochvi.sampling.plain_values import digest_of
from stochvi.sampling.workers import packed, unpacked
from stochvi.scenes.impact_laws import Law
from stochvi.scenes.scene import scene_from
from stochvi.scenes.structures import Matrices
from stochvi.testing import assert_agrees
from support.known import values
from support.soft_stops import scene

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


@pytest.mark.parametrize(
    ("method", "law", "words"),
    [
        (linearise, OWN, "law must be 'viscoelastic' where it has a damper, got 'function'"),
        (fokker_planck, OWN, "law.force must depend on the speed by a linear damper alone"),
        (linearise, ForceFunction(force=ball), "law.energy must be known, got none of kind"),
        (fokker_planck, ForceFunction(force=ball), "law.energy must be known, got none of kind"),
    ],
)
def test_a_method_says_by_name_what_it_lacks(method, law: Law, words: str) -> None:
    with pytest.raises(NotApplicable, match=words):
        method(scene(-1.0, 1.0, law))


def test_the_exact_law_needs_the_energy() -> None:
    model = model_of(scene(-1.0, 1.0, ForceFunction(force=ball)))
    assert [each for each in unmet_by_exact(model) if each.startswith("law.energy must be known")]
    assert unmet_by_exact(model_of(scene(-1.0, 1.0, BALL))) == []


def test_a_function_that_numba_does_not_compile_is_refused_in_a_sentence() -> None:
    law = ForceFunction(force=lambda y, v: float(np.interp(y, *{0: [0.0, 1.0]}.values(), [0, 1.0])))
    with pytest.raises(SceneError, match=r"must be a function that numba compiles, got "):
        simulate(scene(-1.0, 1.0, law), paths=8, duration=1.0)


@pytest.mark.parametrize(
    ("force", "words"),
    [
        (lambda y: 1.0, r"takes a deflection \(m\) and a speed \(m/s\)"),
        (lambda y, v: "hard", "returns a number, got ValueError"),
        (lambda y, v: -y, "not negative at rest, got -1e-09 at 1e-09 m"),
        (lambda y, v: float("nan"), "finite number"),
    ],
)
def test_a_function_that_is_no_force_is_refused(force, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        ForceFunction(force=force)


# ---- a law of the package is two files ----------------------------------------------------------

WRITTEN = '''
"""The contact of round bodies with a loss that grows with the speed."""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from stochvi.mathematics.arrays import Vector
from stochvi.scenes.impact_laws.base import CompliantLaw, inside
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
        from stochvi.engine.laws.hunt_crossley import HuntCrossley as Compiled

        return Compiled(self.coefficient, self.exponent, self.loss)
'''

FLIES = '''
"""The contact of round bodies with a loss that grows with the speed."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.law import force, is_lossy, is_smooth, rate, read


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


@read.of(HuntCrossley)
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

SCENE_OF_ONE = """
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0
[[impact_pair]]
lower = -1.0
upper = 1.0
law = { kind = "hunt-crossley", coefficient = 200.0, exponent = 1.4, loss = 0.3 }
[[excitation]]
kind = "white"
intensity = 0.2
"""

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
    for room, text in (("scenes/impact_laws", WRITTEN), ("engine/laws", FLIES)):
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
