"""Spectra from records against exact ones, and against scipy on the same records."""

import math
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.signal import csd, welch

from stochvi.mathematics.spectra import squared_gain
from stochvi.methods.closed_form import autocorrelation, exact
from stochvi.methods.linearisation import linearise
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_histories
from stochvi.results.errors import NotConverged
from stochvi.results.estimates import CONFIDENCE
from stochvi.sampling import run as sampling_run
from stochvi.sampling.calculations import blocks_of
from stochvi.scenes.excitations import ConstantLoad, FilteredNoise, Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Hertz, Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Isolator, Matrices, Oscillator
from stochvi.statistics import spectra
from stochvi.statistics.spectra import (
    Curve,
    _cross,
    channels_of,
    layout_of,
    products,
    quantities_of,
    spectrum,
)
from support.accuracies import quick_cases

B, S0 = 0.2, 0.4


def oscillator(stiffness: float = 1.0, gap: float | None = None, restitution: float = 1.0) -> Scene:
    law = Restitution(coefficient=restitution)
    stops = [] if gap is None else [ImpactPair(lower=-gap, upper=gap, law=law)]
    return Scene(
        structure=Oscillator(mass=1.0, damping=B, stiffness=stiffness),
        impact_pairs=stops,
        excitations=[WhiteNoise(intensity=S0)],
    )


FREE = oscillator()


def exact_density(f: np.ndarray, damping: float = B) -> np.ndarray:
    return 2.0 * S0 * squared_gain(f, 1.0, damping)


def assert_covered(curve: Curve, truth: np.ndarray, resolution: float) -> None:
    """At least 95 % of frequencies in the band, but for what independent bins may miss by."""
    independent = (curve.frequency_hz[-1] - curve.frequency_hz[0]) * resolution
    allowed = 3.0 * math.sqrt(CONFIDENCE * (1.0 - CONFIDENCE) / independent)
    assert curve.holds(truth).mean() >= CONFIDENCE - allowed


def misses(curve: Curve, truth: np.ndarray) -> bool:
    return bool(curve.holds(truth).mean() < 0.8)


@pytest.fixture(scope="module")
def free():
    return spectrum(FREE, rel_error=0.03, seed=3, threads=1)


def test_estimate_is_that_of_scipy() -> None:
    plan = plan_histories(FREE).sampled(0.1, 400.0)
    records = plan.histories(1, 0, 2)
    x, f = records.displacement[0], records.excitation
    layout = layout_of(plan, "welch", 100.0, 1.0)
    found = products(np.stack([x, f]), layout)
    options = {"fs": 1.0 / plan.step, "window": "hann", "nperseg": layout.tapers.shape[1]}
    grid, density = welch(x, **options)
    cross = csd(x, f, **options)[1]
    np.testing.assert_allclose(layout.frequency_hz, grid[layout.bins], rtol=1e-12)
    np.testing.assert_allclose(found[:, 0], density[:, layout.bins], rtol=1e-9)
    np.testing.assert_allclose(found[:, 2] + 1j * found[:, 3], cross[:, layout.bins], rtol=1e-7)


def test_the_cross_density_of_sums_is_that_of_their_transforms() -> None:
    """Of sums with complex weights over three channels, from the rows that `products` makes."""
    random = np.random.default_rng(5)
    first, second, waves = random.normal(size=(3, 3, 6)) + 1j * random.normal(size=(3, 3, 6))
    rows = [np.abs(wave) ** 2 for wave in waves]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        product = waves[i].conj() * waves[j]
        rows += [product.real, product.imag]
    whole = np.sum(first * waves, axis=0).conj() * np.sum(second * waves, axis=0)
    assert _cross(first, second)(np.array(rows)) == pytest.approx(whole, rel=1e-12)


def test_exact_spectrum_lies_in_the_band(free) -> None:
    curves, f = free.curves["x"], free.frequency_hz
    truth, w = exact_density(f), 2.0 * np.pi * f
    assert_covered(curves["displacement"], truth, free.segment)
    assert_covered(curves["velocity"], w**2 * truth, free.segment)
    # a density off by a factor of two, or another damping, does not
    assert misses(curves["displacement"], 2.0 * truth)
    near = np.abs(f - 1.0 / (2.0 * np.pi)) < 0.02
    held = curves["displacement"].holds(exact_density(f, 0.8 * B))
    assert held[near].mean() < 0.5


def test_band_is_not_too_wide(free) -> None:
    """Without its bias the band holds 95 % and not all: the errors are no larger than they are."""
    curve = free.curves["x"]["displacement"]
    z = (curve.value - exact_density(free.frequency_hz)) / curve.standard_error
    independent = len(z) / 2.0
    assert abs(np.std(z) - 1.0) < 4.5 / math.sqrt(2.0 * independent)


def test_smearing_is_what_the_kernel_does_to_the_exact_spectrum() -> None:
    """A third of the usual segment: the peak is lowered by what is stated, within its noise."""
    short = 7.0 * 2.0 * np.pi / B
    found = spectrum(FREE, paths=256, segment=short, seed=1, threads=1)
    curve = found.curves["x"]["displacement"]
    peak = int(np.argmax(exact_density(found.frequency_hz)))
    lowered = exact_density(found.frequency_hz)[peak] - curve.value[peak]
    assert lowered > 0.0
    assert curve.bias[peak] > 0.5 * lowered - curve.standard_error[peak]
    # 4 / (3 (B T)^2) of the peak
    expected = 4.0 / 3.0 / 49.0 * curve.value[peak]
    assert abs(curve.bias[peak] - expected) < expected


def test_transmissibility_and_coherence_without_stops(free) -> None:
    curves = free.curves["x"]
    w = 2.0 * np.pi * curves["coherence"].frequency_hz
    theory = np.sqrt((1.0 + (B * w) ** 2) * squared_gain(w / (2.0 * np.pi), 1.0, B))
    for name in ("transmissibility_h1", "transmissibility_ratio"):
        assert_covered(curves[name], theory, free.segment)
        assert misses(curves[name], 1.05 * theory)
        assert np.max(np.abs(curves[name].value / theory - 1.0)) < 0.01
    assert curves["coherence"].value.min() > 0.99
    assert_covered(curves["excitation"], np.full_like(w, 2.0 * S0), free.segment)


def transformed(scene: Scene, f: np.ndarray, longest: float) -> np.ndarray:
    """G(f) = 4 integral_0^inf R(t) cos(2 pi f t) dt from the exact autocorrelation."""
    lag = np.linspace(0.0, longest, 10_001)
    known = autocorrelation(scene, lag)
    return np.array([4.0 * simpson(known * np.cos(2.0 * np.pi * each * lag), x=lag) for each in f])


@quick_cases("scene", [oscillator(0.0, 1.0), FREE], ids=["box", "free"], keep=(1,))
def test_spectrum_of_an_exact_autocorrelation(scene: Scene) -> None:
    found = spectrum(scene, seed=2, threads=1)
    curve = found.curves["x"]["displacement"]
    few = slice(0, None, 3)
    truth = transformed(scene, curve.frequency_hz[few], 150.0)
    thinned = Curve(**{name: values[few] for name, values in vars(curve).items()})
    assert_covered(thinned, truth, found.segment / 3.0)
    assert misses(thinned, 2.0 * truth)


def test_multitaper_agrees() -> None:
    found = spectrum(FREE, paths=16, method="multitaper", seed=5, threads=1)
    curve = found.curves["x"]["displacement"]
    # 2 NW tapers smear over 2 NW bins of the whole path
    assert_covered(curve, exact_density(found.frequency_hz), found.segment / 8.0)
    assert misses(curve, 2.0 * exact_density(found.frequency_hz))


def test_several_coordinates() -> None:
    mass, damping = np.diag([1.0, 0.5]), np.array([[0.4, -0.2], [-0.2, 0.2]])
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]])
    scene = Scene(
        structure=Matrices(
            coordinates=["frame", "box"],
            mass=mass.tolist(), damping=damping.tolist(), stiffness=stiffness.tolist(),
        ),
        excitations=[WhiteNoise(intensity=S0, on="frame")],
    )  # fmt: skip
    found = spectrum(scene, paths=32, seed=1, threads=1)
    w = (2.0 * np.pi * found.frequency_hz)[:, None, None]
    gain = np.linalg.inv(stiffness - w**2 * mass + 1j * w * damping)[:, :, 0]
    for row, name in enumerate(("frame", "box")):
        truth = 2.0 * S0 * np.abs(gain[:, row]) ** 2
        assert_covered(found.curves[name]["displacement"], truth, found.segment)
        assert misses(found.curves[name]["displacement"], 2.0 * truth)
    assert "left out" in found.meanings["acceleration"]
    assert "left out" in found.meanings["coherence"]


def truck(**stops) -> Scene:
    pairs = [ImpactPair(**stops)] if stops else []
    return Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1),
        impact_pairs=pairs,
        excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
    )


def test_mount_on_a_truck() -> None:
    found = spectrum(truck(), seed=1, threads=1)
    curves, model = found.curves["x"], model_of(truck())
    (table,) = model.acceleration_tables
    f = curves["coherence"].frequency_hz
    inside = f > 5.0 + 3.0 / found.segment  # the table begins with a jump, which is smeared
    gain = squared_gain(f, model.omega, model.damping_rate)
    square = (model.omega**4 + (model.damping_rate * 2.0 * np.pi * f) ** 2) * gain
    for name, truth in (
        ("transmissibility_h1", np.sqrt(square)),
        ("transmissibility_ratio", np.sqrt(square)),
    ):
        assert np.max(np.abs(curves[name].value / truth - 1.0)[inside]) < 0.01
    whole = found.frequency_hz >= f[0]
    acceleration = curves["acceleration"]
    held = acceleration.holds(np.append(np.zeros((~whole).sum()), table(f) * square))[whole]
    assert held[inside].mean() > CONFIDENCE - 0.05
    assert curves["coherence"].value[inside].min() > 0.99


def test_records_shorter_than_what_is_synthesised_keep_their_excitation() -> None:
    """A short segment asks for records that end within a period of the synthesis. Far above the
    resonance a linear motion is coherent with its excitation, if both begin at the same time."""
    found = spectrum(truck(), paths=8, segment=1.0).curves["x"]["coherence"]
    assert np.all(found.value[found.frequency_hz > 30.0] > 0.99)


def test_what_lies_outside_the_band_of_a_table_raises_no_warning_of_numpy() -> None:
    stops = ImpactPair(clearance=3e-3, law=Hertz(coefficient=1e8))
    mount = Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectrum(truck().replace(structure=mount, impact_pairs=[stops]), paths=16, threads=1)


@quick_cases("sine", [False, True], keep=(0,))
def test_two_storeys_on_a_truck(sine: bool) -> None:
    mass, damping = np.diag([2.0, 0.5]), np.array([[30.0, -5.0], [-5.0, 5.0]])
    stiffness = np.array([[14000.0, -4000.0], [-4000.0, 4000.0]])
    table = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz", on="base")
    tone = Sine(on="base", amplitude=1.0, frequency_hz=30.0)
    scene = Scene(
        structure=Matrices(
            coordinates=["box", "board"],
            mass=mass.tolist(), damping=damping.tolist(), stiffness=stiffness.tolist(),
        ),
        excitations=[table, tone] if sine else [table],
    )  # fmt: skip
    found = spectrum(scene, paths=32, seed=1, threads=1)
    f = found.frequency_hz
    # the table begins with a jump, and the sine is a line: both are smeared
    away = f > 5.0 + 3.0 / found.segment
    if sine:
        away &= np.abs(f - 30.0) > 5.0 / found.segment
    w = 2.0 * np.pi * f[:, None, None]
    gain = -np.linalg.inv(stiffness - w**2 * mass + 1j * w * damping) @ mass.sum(axis=1)
    (density,) = (signal for signal, _ in model_of(scene).tables)
    for row, name in enumerate(("box", "board")):
        truth = density(f) * np.abs(gain[:, row]) ** 2
        curve = found.curves[name]["displacement"]
        kept = Curve(**{name: values[away] for name, values in vars(curve).items()})
        assert_covered(kept, truth[away], found.segment)
        assert misses(kept, 1.2 * truth[away])


def test_nothing_is_told_of_a_ratio_at_the_jump_of_a_table() -> None:
    law = Restitution(coefficient=0.5)
    found = spectrum(truck(lower=-4e-3, upper=4e-3, law=law), paths=64, threads=1)
    curves, bin_width = found.curves["x"], 1.0 / found.segment
    assert 2.0 * bin_width < curves["coherence"].frequency_hz[0] - 5.0 < 3.5 * bin_width
    # what is left out was far off: the next bins are like those after them
    first, later = curves["coherence"].value[0], curves["coherence"].value[1:10]
    scatter = math.hypot(curves["coherence"].standard_error[0], later.std(ddof=1))
    assert abs(first - later.mean()) < 4.5 * scatter
    # densities are told there, too
    assert (np.abs(curves["displacement"].frequency_hz - 5.0) < bin_width).any()


def test_stops_part_the_two_transmissibilities() -> None:
    law = Restitution(coefficient=0.5)
    curves = spectrum(truck(lower=-2e-3, upper=2e-3, law=law), paths=64, threads=1).curves["x"]
    h1, ratio = curves["transmissibility_h1"].value, curves["transmissibility_ratio"].value
    coherence = curves["coherence"].value
    assert np.all(h1 <= ratio * (1.0 + 1e-9))
    np.testing.assert_allclose(coherence, (h1 / ratio) ** 2, rtol=1e-9)
    assert np.median(coherence) < 0.95


def test_whole_acceleration_with_a_stop_that_gives_way() -> None:
    """By springs, damper and stop it is x'' less the input: -(w^2 X + f), from the same records."""
    scene = Scene(
        structure=Isolator(mass=1.0, damping=1.2, stiffness=40.0),
        impact_pairs=[ImpactPair(upper=0.1, law=Elastic(stiffness=400.0))],
        excitations=[WhiteNoise(intensity=0.5)],
    )
    found = spectrum(scene, paths=32, seed=1, threads=1)
    assert found.meanings["acceleration"] == "absolute"
    whole = found.curves["x"]["acceleration"]
    plan = plan_histories(scene).sampled(found.step, 4.0 * found.segment)
    records = plan.histories(1, 0, 32)
    layout = layout_of(plan, "welch", found.segment, found.frequency_hz[-1])
    rows = products(np.stack([records.displacement[0], records.excitation]), layout).mean(axis=0)
    w = 2.0 * np.pi * layout.frequency_hz
    other = w**4 * rows[0] + rows[1] + 2.0 * w**2 * rows[2]
    other = np.interp(found.frequency_hz, layout.frequency_hz, other)
    low = found.frequency_hz < 2.0
    assert np.median(np.abs(whole.value / other - 1.0)[low]) < 0.02


def linearised(scene: Scene, f: np.ndarray) -> np.ndarray:
    """Of the oscillator with the spring and damper that give the moments of the closure."""
    found = linearise(scene).coordinates["x"]
    x2, v2 = (found[f"{name}_mean_square"].value for name in ("displacement", "velocity"))
    return 2.0 * S0 * squared_gain(f, math.sqrt(v2 / x2), S0 / (2.0 * v2))


def test_linearised_spectrum_is_close_for_rare_weak_impacts() -> None:
    def error(gap: float) -> float:
        scene = oscillator(1.0, gap, 0.95)
        found = spectrum(scene, seed=1, threads=1)
        curve = found.curves["x"]["displacement"]
        ratio = np.log(linearised(scene, curve.frequency_hz) / curve.value)
        return float(np.sqrt(np.average(ratio**2, weights=curve.value)))

    rare, often = error(3.5), error(1.0)
    assert rare < 0.15 < 0.5 < often


def test_a_mass_that_a_load_alone_presses_on_a_stop() -> None:
    pressed = Scene(
        structure=Oscillator(mass=1.0, damping=B, stiffness=0.0),
        impact_pairs=[ImpactPair(upper=1.0, law=Restitution(coefficient=1.0))],
        excitations=[WhiteNoise(intensity=S0), ConstantLoad(force=1.0)],
    )
    found = spectrum(pressed, paths=64, seed=2, threads=1)
    curve, df = found.curves["x"]["velocity"], 1.0 / found.segment
    # kicks and jumps by 2 w have the density 2 (S0 + 4 F2) / (2 pi f)^2 above the band, F2 = E w^2
    # impacts per second, of the law (g / s^2) exp(-g (1 - x) / s^2) with s = g = 1
    above = 2.0 * (S0 + 8.0 / math.sqrt(2.0 * math.pi)) / (2.0 * math.pi) ** 2
    area = float(curve.value.sum() * df + above / curve.frequency_hz[-1])
    truth = S0 / (2.0 * B)
    # errors of bins add up in quadrature; neighbours share 4/9 of theirs, on either side
    error = df * math.sqrt(1.0 + 8.0 / 9.0) * float(np.linalg.norm(curve.standard_error))
    assert abs(area - truth) < 4.5 * error + df * float(curve.bias.sum())
    assert abs(1.05 * area - truth) > 4.5 * error + df * float(curve.bias.sum())


def test_nothing_is_transmitted_without_spring_and_damper() -> None:
    box = oscillator(0.0, 1.0, 0.5).replace(
        structure=Oscillator(mass=1.0, damping=0.0, stiffness=0.0)
    )
    found = spectrum(box, paths=16, threads=1)
    assert found.curves["x"].keys() == {"displacement", "velocity", "excitation"}
    assert "left out" in found.meanings["coherence"]


def test_area_is_the_variance_with_stops() -> None:
    scene = oscillator(1.0, 1.0)
    found = spectrum(scene, seed=1, threads=1)
    curve, df = found.curves["x"]["displacement"], 1.0 / found.segment
    below = curve.value[0] * (found.frequency_hz[0] - df / 2.0)
    area = float(curve.value.sum() * df + below)
    truth = exact(scene).coordinates["x"]["displacement_mean_square"].value
    # errors of bins add up in quadrature; neighbours share 4/9 of theirs, on either side
    error = df * math.sqrt(1.0 + 8.0 / 9.0) * float(np.linalg.norm(curve.standard_error))
    assert abs(area - truth) < 4.5 * error + df * float(curve.bias.sum())
    assert abs(2.0 * area - truth) > 4.5 * error + df * float(curve.bias.sum())


def test_filtered_noise_and_sine() -> None:
    scene = Scene(
        structure=Isolator(frequency_hz=1.0, zeta=0.1),
        excitations=[
            FilteredNoise(density=0.1, unit="(m/s2)2/Hz", frequency_hz=2.0, zeta=0.2),
            Sine(amplitude=1.0, frequency_hz=1.5),
        ],
    )
    found = spectrum(scene, paths=8, threads=1)
    assert any("line" in warning for warning in found.warnings)
    curve = found.curves["x"]["displacement"]
    assert abs(curve.frequency_hz[np.argmax(curve.value)] - 1.5) < 3.0 / found.segment
    assert "excitation" not in found.curves["x"]


def test_views_and_errors() -> None:
    found = spectrum(FREE, paths=4, threads=1)
    frame = found.to_frame()
    assert set(frame["quantity"]) >= {"displacement", "velocity", "coherence"}
    assert frame.notna().all().all()
    assert found.to_dict()["method"] == "spectrum:welch"
    with pytest.raises(ValueError, match="method must be"):
        spectrum(FREE, method="periodogram")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="segment must be at least"):
        spectrum(FREE, segment=1.0)
    with pytest.raises(ValueError, match="paths must be"):
        spectrum(FREE, paths=1)
    with pytest.raises(ValueError, match="paths must be a whole number"):
        spectrum(FREE, paths=64.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="give rel_error or paths, not both"):
        spectrum(FREE, paths=64, rel_error=0.1)
    with pytest.raises(ValueError, match="rel_error must be in"):
        spectrum(FREE, rel_error=0.0)


def test_an_answer_that_falls_short_is_carried_by_an_error() -> None:
    with pytest.raises(NotConverged, match=r"relative standard error .* asked for 0\.001") as short:
        spectrum(FREE, rel_error=1e-3, budget=1e-3, threads=1)
    answer = short.value.partial
    assert answer.relative_error > 1e-3
    assert answer.warnings[0] == "the accuracy asked for was not reached"
    with pytest.raises(NotConverged, match=r"0.001 s ended after \d+ of 100000 paths") as short:
        spectrum(FREE, paths=10**5, budget=1e-3, threads=1)
    assert 2 <= short.value.partial.cost.paths < 10**5


def test_time_that_runs_out_before_a_block_of_a_later_round_keeps_the_rounds_before(
    monkeypatch,
) -> None:
    now, rounds = [0.0], []

    def the_second_round_is_late(*asked):
        rounds.append(asked)
        now[0] = 0.0 if len(rounds) == 1 else 1e3
        return blocks_of(*asked)

    monkeypatch.setattr(sampling_run, "blocks_of", the_second_round_is_late)
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: now[0]))
    with pytest.raises(NotConverged, match="raise budget") as short:
        spectrum(FREE, rel_error=1e-3, threads=1)
    assert len(rounds) == 2 and short.value.partial.cost.paths == spectra.FEWEST_PATHS


def test_a_record_that_ends_before_it_was_promised_to_is_refused() -> None:
    plan = plan_histories(FREE).sampled(0.1, 50.0)
    assert plan.histories(1, 0, 2).displacement.shape[2] == plan.samples
    longer = replace(plan, duration=2.0 * plan.duration)
    with pytest.raises(AssertionError, match="samples, 1000 were promised"):
        longer.histories(1, 0, 2)


def test_stops_that_give_way_push_on_every_coordinate_of_a_structure() -> None:
    masses, law = np.array([2.0, 3.0]), Elastic(stiffness=50.0)
    structure = Matrices(
        coordinates=["a", "b"], mass=np.diag(masses), damping=np.diag([0.4, 0.6]),
        stiffness=[[9.0, -2.0], [-2.0, 8.0]],
    )  # fmt: skip
    pairs = [
        ImpactPair(name="on a", on="a", upper=0.5, law=law),
        ImpactPair(name="rigid", on="b", upper=0.7, law=Restitution(coefficient=0.5)),
        ImpactPair(name="between", between=["a", "b"], lower=-0.2, upper=0.3, law=law),
    ]
    noise = WhiteNoise(on="base", intensity=0.3)
    scene = Scene(structure=structure, impact_pairs=pairs, excitations=[noise])
    plan = plan_histories(scene)
    x = np.array([[[0.6, 0.0]], [[0.1, 0.4]]])
    moved = SimpleNamespace(displacement=x, velocity=0.0 * x, excitation=None)
    channels = channels_of(plan, moved)
    assert channels[2:, 0].tolist() == pytest.approx(np.array([[5.0, 0.0], [10.0, -10.0]]))
    found, _ = quantities_of(scene, plan, np.array([1.0, 2.0]))
    for channel, direction in ((2, [1.0, 0.0]), (3, [1.0, -1.0])):
        rows = np.zeros((4 + 4 * 3, 2))
        rows[channel] = 1.0
        for name, to, mass in zip("ab", direction, masses, strict=True):
            density = found[name, "acceleration"](rows)
            assert density.tolist() == pytest.approx([(to / mass) ** 2] * 2)


@pytest.mark.slow
def test_bandwidth_and_degrees_of_freedom_are_what_the_scatter_shows() -> None:
    """The half-power bandwidth of an oscillator is b / (2 pi); over seeds the density scatters by
    2 / degrees of freedom of its square."""
    scene = Scene(
        structure=Oscillator(mass=1.0, damping=0.2, stiffness=1.0),
        excitations=[WhiteNoise(intensity=0.2)],
    )
    runs = [spectrum(scene, paths=16, seed=seed, threads=1) for seed in range(60)]
    assert runs[0].bandwidth == pytest.approx(0.2 / (2.0 * np.pi), rel=1e-6)
    curves = [next(iter(run.curves["x"].values())) for run in runs]
    values = np.array([curve.value for curve in curves])
    seen = np.mean(values, axis=0) ** 2 / np.var(values, axis=0, ddof=1)
    scattered = 2.0 * float(np.median(seen))
    stated = float(np.median([run.degrees_of_freedom for run in runs]))
    # the bins of one run hang together: the median over them is known to some per cent
    assert stated == pytest.approx(scattered, rel=0.25)
    assert stated != pytest.approx(2.0 * scattered, rel=0.25)
