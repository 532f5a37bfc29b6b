"""Statistics of one's own: their values, where velocities are taken, and what is refused."""

import dataclasses
import math
from pathlib import Path

import pytest
from scipy.stats import norm

import stochvi
from stochvi import Estimate, SceneError, Statistic, simulate
from stochvi.methods.monte_carlo import modal
from stochvi.results.errors import CheckpointError
from stochvi.scenes.excitations import TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Matrices, Oscillator

GAP = 0.8
"""Distance of the stops, m: k = 1, b = .1, S0 = .2, so that x and v have the deviation 1."""


def oscillator(law: object, damping: float = 0.1, **pair: float) -> Scene:
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=[ImpactPair(law=law, **(pair or {"lower": -GAP, "upper": GAP}))],
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


def half_way(x: float, v: float) -> float:
    return 1.0 if x > 0.4 else 0.0


def fast(x: float, v: float) -> float:
    return 1.0 if v > 1.0 else 0.0


def product(x: float, v: float) -> float:
    return x**2 * v**4


def square(x: float, v: float) -> float:
    return v * v


def beyond(x: float, v: float) -> float:
    return 1.0 if x > GAP else 0.0


def away(found: Estimate, truth: float) -> float:
    """Distance from the truth in standard errors, beyond the bias."""
    return max(abs(found.value - truth) - found.bias, 0.0) / found.standard_error


# ---- values -----------------------------------------------------------------------------------


def test_means_are_those_of_the_exact_density() -> None:
    asked = {each.__name__: Statistic(function=each) for each in (half_way, fast, product)}
    scene = oscillator(Restitution(coefficient=1.0))
    found = simulate(scene, statistics=asked, paths=1024, seed=3).statistics
    inside = norm.cdf(GAP) - norm.cdf(-GAP)
    variance = 1.0 - 2.0 * GAP * norm.pdf(GAP) / inside
    known = {
        "half_way": (norm.cdf(GAP) - norm.cdf(0.4)) / inside,
        "fast": norm.sf(1.0),
        "product": 3.0 * variance,
    }
    assert all(away(found[name], truth) < 4.5 for name, truth in known.items())
    assert all(away(found[name], 1.05 * truth) > 4.5 for name, truth in known.items())


def test_velocities_are_taken_in_the_middle_of_a_kick(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = oscillator(Restitution(coefficient=0.5), damping=1.0)
    asked = {"square": Statistic(function=square)}

    def apart() -> float:
        found = simulate(scene, statistics=asked, paths=1024, seed=5)
        own, known = found.statistics["square"], found.coordinates["x"].velocity_mean_square
        return abs(own.value - known.value) / math.hypot(own.standard_error, known.standard_error)

    assert apart() < 4.5
    whole = modal.statistics_of
    monkeypatch.setattr(
        modal, "statistics_of", lambda *of: whole(*of)._replace(spreads=0.0 * whole(*of).spreads)
    )
    assert apart() > 4.5


TABLE = TabulatedNoise(frequency_hz=[0.05, 0.3], density=[0.4, 0.4], unit="N2/Hz")


@pytest.mark.slow
@pytest.mark.parametrize("noise", [WhiteNoise(intensity=0.2), TABLE], ids=["white", "table"])
def test_time_in_contact_is_that_of_the_contacts(noise: object) -> None:
    several = Matrices(
        mass=[[1.0, 0.0], [0.0, 0.5]], damping=[[0.2, -0.1], [-0.1, 0.1]],
        stiffness=[[2.0, -1.0], [-1.0, 1.0]], coordinates=["a", "b"],
    )  # fmt: skip
    scene = Scene(
        structure=several,
        impact_pairs=[
            ImpactPair(name="gap", between=["a", "b"], upper=GAP, law=Elastic(stiffness=30.0))
        ],
        excitations=[noise.replace(on="a")],
    )
    asked = {"time": Statistic(function=beyond, of="gap")}
    found = simulate(scene, statistics=asked, rel_error=0.03, seed=2)
    contact = found.impact_pairs["gap"].contact_probability
    own = found.statistics["time"]
    error = 4.5 * math.hypot(own.standard_error, contact.standard_error)
    assert abs(own.value - contact.value) < error + own.bias + contact.bias
    assert error < 0.2 * own.value
    of_a = simulate(scene, statistics={"a": Statistic(function=beyond, of="a")}, paths=256, seed=2)
    assert abs(of_a.statistics["a"].value - contact.value) > error


@pytest.mark.verify
def test_time_in_contact_of_six_modes() -> None:
    scene = stochvi.load_scene(stochvi.scenes.shipped_scene("rigid-box"))
    lower, upper = -0.002, 0.0005
    soft = Elastic(stiffness=5e5)
    pair = scene.impact_pairs[0].replace(law=soft, lower=lower, upper=upper)
    scene = scene.replace(impact_pairs=[pair, *scene.impact_pairs[1:]])

    def outside(y: float, v: float) -> float:
        return 1.0 if y > upper or y < lower else 0.0

    def above(y: float, v: float) -> float:
        return 1.0 if y > upper else 0.0

    asked = {
        "time": Statistic(function=outside, of=pair.name),
        "half": Statistic(function=above, of=pair.name),
    }
    found = simulate(scene, statistics=asked, paths=512, seed=2)
    contact = found.impact_pairs[pair.name].contact_probability

    def apart(name: str) -> float:
        own = found.statistics[name]
        error = math.hypot(own.standard_error, contact.standard_error)
        return (abs(own.value - contact.value) - own.bias - contact.bias) / error

    assert apart("time") < 4.5
    assert apart("half") > 4.5


# ---- answers ----------------------------------------------------------------------------------


def test_an_answer_with_statistics_is_written_and_read(tmp_path: Path) -> None:
    scene = oscillator(Restitution(coefficient=1.0))
    found = simulate(scene, statistics={"fast": Statistic(function=fast)}, paths=64, duration=50.0)
    row = found.to_frame().iloc[-1]
    assert (row["of"], row["quantity"], row["unit"]) == ("statistics", "fast", "")
    assert "statistics.fast = " in repr(found)
    stochvi.save_answer(found, tmp_path / "answer.json")
    assert stochvi.load_answer(tmp_path / "answer.json").statistics == found.statistics
    recorded = found.provenance["call"]["arguments"]["statistics"]["fast"]
    assert recorded["function"].startswith(f"{__name__}.fast (")
    assert "statistics" not in simulate(scene, paths=64, duration=50.0).to_dict()


def test_a_run_goes_on_with_the_same_functions_only(tmp_path: Path) -> None:
    scene, kept = oscillator(Restitution(coefficient=1.0)), tmp_path / "kept"
    asked = {"fast": Statistic(function=fast)}
    run = {"paths": 64, "duration": 50.0, "seed": 1}
    first = simulate(scene, statistics=asked, checkpoint=kept, **run)
    assert simulate(scene, statistics=asked, resume=kept, **run) == first
    with pytest.raises(CheckpointError, match="is of a run with statistics"):
        simulate(scene, statistics={"fast": Statistic(function=half_way)}, resume=kept, **run)
    with pytest.raises(ValueError, match="give each function anew"):
        simulate(scene, resume=kept, **run)


# ---- what is refused --------------------------------------------------------------------------


def test_a_function_that_cannot_be_averaged_is_refused_in_a_sentence() -> None:
    with pytest.raises(SceneError, match=r"takes a displacement .* got missing a"):
        Statistic(function=lambda x, v, a: x)
    with pytest.raises(SceneError, match="needs function that numba compiles"):
        Statistic(function=lambda x, v: dataclasses.asdict(x))


def test_a_statistic_of_nothing_in_the_scene_is_refused() -> None:
    scene = oscillator(Restitution(coefficient=1.0))
    with pytest.raises(ValueError, match=r"pair of the scene \(stops, x\), got 'y'"):
        simulate(scene, statistics={"fast": Statistic(function=fast, of="y")})
    with pytest.raises(ValueError, match="must be a table of names and `Statistic`"):
        simulate(scene, statistics={"fast": fast})
