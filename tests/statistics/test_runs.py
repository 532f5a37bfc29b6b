"""Whatever ends a calculation early: what it states holds as often as it says, or is an upper
limit."""

from __future__ import annotations

import errno
import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import stochvi.sampling.checkpoints as checkpoints
from stochvi import Oscillator, absorber, lifetimes, size
from stochvi.cli import main
from stochvi.isolators import clatter, clearance_curve
from stochvi.methods.closed_form import exact
from stochvi.methods.fokker_planck import first_passage
from stochvi.methods.monte_carlo import simulate
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import plan_impacts
from stochvi.results.errors import CheckpointError, NotConverged
from stochvi.results.estimates import GAUSSIAN_95, Estimate, PathMoments, mean_and_error
from stochvi.sampling.checkpoints import LONG_SECONDS, Checkpoint, digest_of, from_plain, to_plain
from stochvi.sampling.workers import WorkerPool
from stochvi.scenes.absorbers import Absorber
from stochvi.scenes.excitations import Sine, TabulatedNoise, WhiteNoise
from stochvi.scenes.impact_laws import Elastic, Restitution
from stochvi.scenes.phases import MovingBand, Phase
from stochvi.scenes.scene import ImpactPair, Scene, load_scene
from stochvi.scenes.structures import Isolator
from stochvi.statistics.impacts import impacts
from stochvi.statistics.reliability import reliability
from stochvi.statistics.reliability.missions import lag_of
from stochvi.statistics.spectra import spectrum
from support.accuracies import quick_cases
from support.clocks import tick
from support.commands import killed_at_its_first_sample
from support.known import oscillator as between_stops
from support.known import to_toml

# ------------------------------------------------------------------------------
# Spectra, impacts and reliability that go on: the digits of a run that never stopped.
# ------------------------------------------------------------------------------


CLOCK = ("cost", "seconds", "crude_seconds", "seconds_per_mission", "call")
"""Keys of documents that hold times and calls, which differ from run to run."""


def oscillator(restitution: float = 0.8) -> Scene:
    return between_stops(-1.0, 1.0, restitution)


TOML = to_toml(oscillator().document())


def truck() -> Scene:
    pair = ImpactPair(lower=-0.004, upper=0.004, law=Restitution(coefficient=0.5))
    table = TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")
    mount = Isolator(frequency_hz=12.0, zeta=0.1)
    return Scene(structure=mount, impact_pairs=[pair], excitations=[table])


def without_times(part: Any) -> Any:
    """A document without what differs from run to run."""
    if isinstance(part, dict):
        return {key: without_times(each) for key, each in part.items() if key not in CLOCK}
    return [without_times(each) for each in part] if isinstance(part, list) else part


def digits(answer: Any) -> str:
    """All of an answer but the times that it took."""
    return json.dumps(without_times(answer.to_dict()))


class Blocks:
    """Counts the blocks that are done, and presses Ctrl-C twice after the n-th."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done, self.stops_at = 0, -1
        do = WorkerPool.do

        def counted(pool: WorkerPool, *asked: Any) -> Any:
            for each in do(pool, *asked):
                yield each
                self.done += 1
                if self.done == self.stops_at:
                    raise KeyboardInterrupt

        monkeypatch.setattr(WorkerPool, "do", counted)

    def of(self, calculate: Callable[[], Any]) -> int:
        """Number of blocks of a calculation."""
        before = self.done
        calculate()
        return self.done - before


RUNS = {  # by paths, and missions one by one: `sampling/test_every_sampler.py`
    "spectrum by error": (spectrum, oscillator, {"rel_error": 0.05}),
    "impacts by error": (impacts, oscillator, {"rel_error": 0.006, "duration": 20.0}),
    "reliability by crossings": (
        reliability,
        truck,
        {"mission": 600.0, "impact_speed": 0.4, "rel_error": 0.3, "budget": None},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_a_stopped_run_goes_on_to_the_digits_of_one_that_never_stopped(
    run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve, scene_of, asked = RUNS[run]
    asked = asked | {"seed": 3}
    again = {key: asked[key] for key in ("mission", "budget") if key in asked}
    scene, kept, blocks = scene_of(), tmp_path / "run", Blocks(monkeypatch)
    whole = solve(scene, **asked)
    number = blocks.done
    assert number > 1
    blocks.done, blocks.stops_at = 0, max(1, number // 2)
    with pytest.raises(KeyboardInterrupt):
        solve(scene, **asked, checkpoint=kept)
    blocks.stops_at = -1
    found = []
    left = blocks.of(lambda: found.append(solve(scene_of(), **again, resume=kept)))
    assert 0 < left <= number - number // 2 + 1  # the block before Ctrl-C may not be kept yet
    assert digits(found[0]) == digits(whole)
    # the checkpoint of a run that ended gives its answer again, without a block
    assert blocks.of(lambda: found.append(solve(scene, **again, resume=kept))) == 0
    assert digits(found[1]) == digits(whole)
    if solve is impacts:  # another seed gives other digits: the comparison sees a difference
        assert digits(solve(scene, **asked | {"seed": 4})) != digits(whole)


@pytest.mark.slow
def test_a_budget_that_cuts_blocks_short_leaves_no_trace(tmp_path: Path) -> None:
    """Blocks that end with the budget are left out of the checkpoint, as they hold fewer paths."""
    scene, kept = oscillator(), tmp_path / "run"
    asked = {"paths": 100_000, "duration": 200.0, "seed": 5}
    with pytest.raises(NotConverged) as reason:
        impacts(scene, **asked, budget=0.1, checkpoint=kept)
    assert reason.value.partial.cost.paths < 100_000
    assert digits(impacts(scene, resume=kept, budget=None)) == digits(
        impacts(scene, **asked, budget=None)
    )


@pytest.mark.slow
def test_killed_it_goes_on(tmp_path: Path) -> None:
    """`kill -9` in the middle, and --resume of the command line."""
    scene, kept = tmp_path / "scene.toml", tmp_path / "run"
    scene.write_text(TOML, encoding="utf-8")
    command = ["impacts", str(scene), "--seed", "2", "--paths", "30000", "--duration", "20"]
    command += ["--threads", "1"]
    killed_at_its_first_sample(*command, "--checkpoint", kept, "--checkpoint-interval", "0.01")
    assert Checkpoint.read(kept).samples
    documents = []
    for more in ([*command], ["impacts", str(scene), "--resume", str(kept)]):
        target = tmp_path / f"{len(documents)}.json"
        found = CliRunner().invoke(main, [*more, "--json", str(target), "--quiet"])
        assert found.exit_code == 0, found.output
        documents.append(without_times(json.loads(target.read_text(encoding="utf-8"))))
    assert documents[0] == documents[1]


def test_what_belongs_to_another_run_is_refused(tmp_path: Path) -> None:
    scene, kept = oscillator(), tmp_path / "run"
    impacts(scene, paths=64, duration=10.0, seed=4, checkpoint=kept)
    for asked, said in (
        ({"seed": 5}, "seed 4, not 5; leave seed out"),
        ({"paths": 65}, "paths 64, not 65"),
        ({"rel_error": 0.1}, r"64 paths, not with rel_error 0\.1"),
        ({"slow_impacts": True}, "slow_impacts False, not True"),
    ):
        with pytest.raises(CheckpointError, match=said):
            impacts(scene, **asked, resume=kept)
    with pytest.raises(CheckpointError, match=r"impact_pair.0.law.coefficient is 0.8 in it, 0.7 h"):
        impacts(oscillator(0.7), resume=kept)
    with pytest.raises(CheckpointError, match="is of impacts, not of spectrum"):
        spectrum(scene, resume=kept)
    with pytest.raises(CheckpointError, match="is of impacts, not of simulate"):
        simulate(scene, resume=kept)
    text = kept.read_bytes()
    kept.write_bytes(text[:-9] + text[-8:])
    with pytest.raises(CheckpointError, match="is damaged"):
        impacts(scene, resume=kept)
    kept.write_bytes(text.replace(b"checkpoint 11", b"checkpoint 6", 1))
    with pytest.raises(CheckpointError, match="another version of stochvi"):
        impacts(scene, resume=kept)
    kept.write_bytes(text)
    found = Checkpoint.read(kept)
    found.model_copy(update={"machine": "another"}).write()
    with pytest.raises(CheckpointError, match="another version or processor"):
        impacts(scene, resume=kept)
    record = {"paths": 1, "goal": 1, "machines": []}
    record["sample"] = {"record": "os:system", "fields": {}}
    document = json.loads(text.partition(b"\n")[2]) | {"samples": {"any": record}}
    body = json.dumps(document).encode()
    header = f"stochvi checkpoint 11 {hashlib.sha256(body).hexdigest()}\n"
    kept.write_bytes(header.encode() + body)
    with pytest.raises(CheckpointError, match="does not hold what a checkpoint"):
        impacts(scene, resume=kept)
    reliability(scene, mission=10.0, rel_error=0.5, checkpoint=kept)
    with pytest.raises(CheckpointError, match=r"mission 10\.0, not 20\.0; leave mission out"):
        reliability(scene, mission=20.0, resume=kept)


def test_a_table_that_changed_is_refused(tmp_path: Path) -> None:
    table, scene, kept = tmp_path / "my.csv", tmp_path / "scene.toml", tmp_path / "run"
    scene.write_text(
        '[structure]\nkind = "isolator"\nfrequency_hz = 12.0\nzeta = 0.1\n'
        '[[excitation]]\nkind = "psd"\nfile = "my.csv"\n',
        encoding="utf-8",
    )
    rows = "frequency_hz,psd_g2_per_hz\n5,0.01\n50,0.01\n100,{}\n"
    table.write_text(rows.format(0.01), encoding="utf-8")
    spectrum(load_scene(scene), paths=2, checkpoint=kept)
    spectrum(load_scene(scene), resume=kept)
    table.write_text(rows.format(0.011), encoding="utf-8")
    with pytest.raises(CheckpointError, match="a file that the scene names has changed"):
        spectrum(load_scene(scene), resume=kept)


def test_what_is_refused_writes_no_checkpoint(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    with pytest.raises(ValueError, match="paths must be at least 2"):
        spectrum(oscillator(), paths=1, checkpoint=kept)
    assert not kept.exists()
    kept.write_text("mine", encoding="utf-8")
    with pytest.raises(CheckpointError, match="is no checkpoint of stochvi"):
        spectrum(oscillator(), paths=2, checkpoint=kept)
    assert kept.read_text(encoding="utf-8") == "mine"


def test_a_long_run_is_kept_as_earlier(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    impacts(oscillator(), paths=64, duration=10.0, checkpoint=kept)
    found = Checkpoint.read(kept)
    found.seconds = 2.0 * LONG_SECONDS
    found.write()
    impacts(oscillator(), paths=64, duration=10.0, checkpoint=kept)
    assert Checkpoint.read(tmp_path / "run.earlier").seconds == 2.0 * LONG_SECONDS


def test_a_full_disk_costs_no_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, left = checkpoints.write_whole, [1]

    def full(data: bytes, path: Path, *, durable: bool = False) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write(data, path, durable=durable)

    scene, asked = oscillator(), {"paths": 300, "duration": 10.0}
    monkeypatch.setattr(checkpoints, "write_whole", full)
    found = impacts(scene, **asked, checkpoint=tmp_path / "run")
    assert any("could not be written: no space left" in each for each in found.warnings)
    monkeypatch.undo()
    whole = impacts(scene, **asked)
    assert found.pairs["stops"].rates == whole.pairs["stops"].rates
    assert digits(impacts(scene, resume=tmp_path / "run")) == digits(whole)


def test_control_c_at_the_command_line_names_the_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, kept, blocks = tmp_path / "scene.toml", tmp_path / "run", Blocks(monkeypatch)
    scene.write_text(TOML, encoding="utf-8")
    blocks.stops_at = 1
    found = CliRunner().invoke(
        main,
        ["spectrum", str(scene), "--rel-error", "0.05", "--checkpoint", str(kept), "--quiet"],
    )
    assert found.exit_code == 1
    assert found.output.strip().endswith(f"; go on with --resume {kept}")


def test_results_of_blocks_keep_every_bit() -> None:
    moments = PathMoments(
        count=3, mean=np.array([0.1, -0.0, np.inf]), scatter=np.full((3, 3), np.pi)
    )
    value = [moments, {"a": (1, 2.5, float("nan"), None)}, np.float32([[1 / 3]]), np.array([True])]
    plain = json.loads(json.dumps(to_plain(value), allow_nan=False))
    again = from_plain(plain)
    assert again[0].mean.tobytes() == moments.mean.tobytes()
    assert again[0].scatter.tobytes() == moments.scatter.tobytes()
    assert repr(again[1]) == repr(value[1])
    assert again[2].dtype == np.float32
    assert again[2].tobytes() == value[2].tobytes()
    assert again[3].dtype == bool
    with pytest.raises(TypeError):
        to_plain([object()])
    for wrong in ({"record": "stochvi.scenes.scene:load_scene", "fields": {}}, {"more": 1}):
        with pytest.raises(ValueError, match=r"."):
            from_plain(wrong)


def test_a_digest_sees_every_number_of_a_work() -> None:
    """One changed number in the last array of a scene's model is another work."""
    from stochvi.model.model import model_of

    first, same = model_of(truck()), model_of(truck())
    assert digest_of(first) == digest_of(same)
    assert digest_of(model_of(oscillator())) != digest_of(model_of(oscillator(0.7999999999999999)))
    one, other = np.zeros(1000), np.zeros(1000)
    other[-1] = 5e-324
    assert digest_of([one]) != digest_of([other])
    assert digest_of([one, 1.0]) != digest_of([one, 1])
    assert digest_of([[1.0], 2.0]) != digest_of([[1.0, 2.0]])


# ------------------------------------------------------------------------------
# Sines that move through a resonance beside noise: an integrator with a true sweep judges.
# ------------------------------------------------------------------------------


F, ZETA, MASS = 10.0, 0.05, 1.0
W, RATE = 2.0 * math.pi * F, 2.0 * math.pi * F * ZETA
DENSITY, FS = 20.0, 400.0
SIGMA = math.sqrt(DENSITY * math.pi * F / (4.0 * ZETA)) / W**2
PEAK, LEVEL = 3.0 * SIGMA, 5.0 * SIGMA
FROM, TO = 6.5, 14.5

Array = NDArray[np.float64]


@pytest.mark.parametrize("zeta", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.5, 1.0])
def test_a_moving_sine_moves_a_mass_less_by_no_more_than_stated(zeta: float, ratio: float) -> None:
    rate, change = zeta * W, ratio * (zeta * W) ** 2
    ends = np.array([-1.0, 1.0]) * (12.0 * rate + 4.0 * math.sqrt(change)) / change

    def turn(t: float) -> complex:
        return complex(np.exp(1j * (W * t + 0.5 * change * t * t)))

    def motion(t: float, y: NDArray[np.complex128]) -> list[complex]:
        return [y[1], turn(t) - 2.0 * rate * y[1] - W**2 * y[0]]

    w = W + change * ends[0]
    start = turn(ends[0]) / (W**2 - w**2 + 2j * rate * w)
    found = solve_ivp(motion, ends, np.array([start, 1j * w * start]), rtol=1e-8, atol=1e-12)
    steady = 1.0 / (2.0 * rate * math.sqrt(W**2 - rate**2))
    less = 1.0 - float(np.abs(found.y[0]).max()) / steady
    mass = Oscillator(mass=1.0, frequency_hz=F, zeta=zeta)
    noise = TabulatedNoise(frequency_hz=[5.0, 20.0], density=[1.0, 1.0], unit="N2/Hz", on="x")
    stated = lag_of(model_of(Scene(structure=mass, excitations=[noise])), change / 2.0 / math.pi)
    assert 0.0 < less < stated < max(2.5 * less, 0.02)


def extremes(duration: float, missions: int) -> Array:
    """Largest distance in missions whose sine moves by equal differences, by a recursion of the
    exact motion between samples."""
    random, step = np.random.default_rng(5), 1.0 / FS
    before = 3.0
    count = round((before + duration) / step)
    length = 2 * count
    bins = np.arange(length // 2 + 1) * FS / length
    w = 2.0 * math.pi * bins
    gain = 1.0 / (W**2 - w**2 + 2j * RATE * w)
    gain[(bins < 4.0) | (bins > 60.0)] = 0.0
    time = step * np.arange(count) - before
    slope = 2.0 * math.pi * (TO - FROM) / duration
    turned = 2.0 * math.pi * FROM * time + 0.5 * slope * np.maximum(time, 0.0) ** 2
    # the complex motion under exp(i turned), from its steady state, at a tenth of the step
    fine = 10
    dense = np.interp(np.arange(count * fine) / fine, np.arange(count), time)
    phase = 2.0 * math.pi * FROM * dense + 0.5 * slope * np.maximum(dense, 0.0) ** 2
    force = np.exp(1j * phase)
    size_ = 2 * len(force)
    wave = math.sqrt(W**2 - RATE**2)
    ages = step / fine * np.arange(len(force))
    kick = np.exp(-RATE * ages) * np.sin(wave * ages) / wave
    moved = np.fft.ifft(np.fft.fft(force, size_) * np.fft.fft(kick, size_))[: len(force) : fine]
    moved *= step / fine * PEAK * 2.0 * RATE * wave
    assert len(turned) == len(moved)
    found = np.empty(missions)
    kept = round(before / step)
    for mission in range(missions):
        normal = random.standard_normal((2, len(bins)))
        spectrum = gain * (normal[0] + 1j * normal[1]) * math.sqrt(DENSITY * FS * length) / 2.0
        x = np.fft.irfft(spectrum, length)[:count]
        x = x + (moved * np.exp(1j * random.uniform(0.0, 2.0 * math.pi))).real
        found[mission] = np.abs(x[kept:]).max()
    return found


@quick_cases("ratio", [0.5, 0.05], keep=(1,))
def test_the_bias_holds_what_steps_that_stand_still_change(ratio: float) -> None:
    change = ratio * RATE**2 / (2.0 * math.pi)
    duration, missions = (TO - FROM) / change, 3000
    steady = 2.0 * RATE * math.sqrt(W**2 - RATE**2)
    band = MovingBand(from_hz=FROM, to_hz=TO, amplitude=PEAK * steady * MASS, on="x")
    noise = TabulatedNoise(frequency_hz=[4.0, 60.0], density=[DENSITY] * 2, unit="N2/Hz", on="x")
    level = LEVEL if ratio > 0.1 else LEVEL + 0.5 * SIGMA
    scene = Scene(
        structure=Oscillator(mass=MASS, frequency_hz=F, zeta=ZETA),
        impact_pairs=[ImpactPair(clearance=level, law=Restitution(coefficient=0.6))],
        excitations=[noise],
        phases=[Phase(name="sweep", duration=duration, moving=[band], sweep="linear", steps=24)],
    )
    found = reliability(scene, seed=1, rel_error=0.15, budget=300.0)
    own = found.chances["hit"].estimate
    counted = float(np.mean(extremes(duration, missions) > level))
    error = math.sqrt(counted * (1.0 - counted) / missions)
    assert own.bias is not None and 0.02 < counted < 0.9
    apart = own.value - counted
    assert abs(apart) < 4.0 * math.hypot(error, own.standard_error) + own.bias
    if ratio > 0.1:  # the control: steps that stand still alone are too careful, visibly
        assert apart > 4.0 * math.hypot(error, own.standard_error)
        sized = size(scene, probability=0.1, seed=1, rel_error=0.15, budget=300.0)
        wide = sized.clearance.upper - sized.clearance.lower
        assert wide > 0.02 * sized.clearance.value
    assert any("what moves through phase sweep" in each for each in found.assumptions)


# ------------------------------------------------------------------------------
# Whatever ends a calculation early:
# ------------------------------------------------------------------------------


Ends = tuple[float, float]

ALL = (0.0, math.inf)
"""Where a budget was too short for an answer."""

MISSION = 20.0 * math.pi
"""Mission of the splitting, s."""


def scene(stop: float | None, *, damping: float = 0.1) -> Scene:
    law = Restitution(coefficient=1.0)
    pairs = [] if stop is None else [ImpactPair(clearance=stop, law=law)]
    return Scene(
        structure=Oscillator(mass=1.0, damping=damping, stiffness=1.0),
        impact_pairs=pairs,
        excitations=[WhiteNoise(intensity=2.0 * damping)],
    )


FAR = scene(2.5, damping=0.05)
"""Elastic stops at 2.5 deviations: impacts come in clusters of some ten periods."""


def partial_answer(calculate: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    try:
        return calculate(*arguments, **named)
    except NotConverged as reason:
        return reason.partial


def ends_of(found: Estimate) -> Ends:
    """The 95 % interval of an estimate of a positive number."""
    if found.upper_95 is not None:
        return 0.0, found.upper_95
    reach = math.exp(found.half_width_95() / found.value)
    bias = found.bias or 0.0
    return found.value / reach - bias, found.value * reach + bias


def simulated_rate(seed: int) -> Ends:
    found = simulate(FAR, paths=12, duration=300.0, seed=seed, threads=1)
    return ends_of(found.impact_pairs["stops"]["collision_rate"])


def simulated_deviation(seed: int) -> Ends:
    found = simulate(FAR, paths=3, duration=300.0, seed=seed, threads=1)
    return ends_of(found.coordinates["x"]["velocity_std"])


def counted_impacts(seed: int) -> Ends:
    found = impacts(FAR, paths=12, duration=300.0, seed=seed, threads=1)
    rate = found.pairs["stops"].rates["both"]
    return rate.lower, rate.upper


def sampled_spectrum(seed: int) -> Ends:
    found = spectrum(scene(None), paths=6, seed=seed, threads=1)
    curve = found.curves["x"]["velocity"]
    place = int(np.argmin(np.abs(found.frequency_hz - 1.0 / (2.0 * math.pi))))
    return float(curve.lower[place]), float(curve.upper[place])


OFTEN = scene(2.5, damping=0.2)
"""The same stops, of which a short mission meets some."""


def hits_of_missions(seed: int) -> Ends:
    found = partial_answer(
        reliability, OFTEN, mission=20.0, rel_error=0.002, budget=0.06, seed=seed, threads=1
    )
    return ALL if found is None or found.hits is None else found.hits_interval


def split_chance(seed: int) -> Ends:
    found = partial_answer(
        reliability, scene(None), mission=MISSION, barrier=4.0, start="rest", way="splitting",
        rel_error=0.01, budget=0.15, seed=seed, threads=1,
    )  # fmt: skip
    chance = found and found.chances.get("passage")
    return (chance.lower, chance.upper) if chance else ALL


SOFT = Scene(
    structure=Isolator(frequency_hz=12.0, zeta=0.1, mass=1.0),
    impact_pairs=[ImpactPair(clearance=8e-3, law=Elastic(stiffness=1e5))],
    excitations=[TabulatedNoise(profile="mil-std-810h-truck-vertical-5hz")],
)
"""Soft stops of a mount under a table."""


def hits_of_bursts(seed: int) -> Ends:
    found = partial_answer(
        reliability, SOFT, mission=10.0, rel_error=0.01, budget=0.05, seed=seed, threads=1
    )
    return ALL if found is None or found.hits is None else found.hits_interval


def clatter_of_windows(seed: int) -> Ends:
    row = clatter(SOFT, [6e-3], rel_error=0.001, budget=0.02, seed=seed, threads=1).iloc[0]
    reach = GAUSSIAN_95 * row["acceleration_rms_error"]
    return row["acceleration_rms"] - reach, row["acceleration_rms"] + reach


def rate_at_a_clearance(seed: int) -> Ends:
    found = partial_answer(
        clearance_curve, FAR, [2.5], rel_error=0.01, budget=0.02, seed=seed, threads=1
    )
    row = found.iloc[0]
    return row["simulated_low"], row["simulated_high"]


ACCEPTED = 0.01
"""Impacts per second for which a clearance is sized."""


def required_clearance(seed: int) -> Ends:
    found = partial_answer(
        size, FAR, rate=ACCEPTED, rel_error=0.05, budget=0.01, seed=seed, threads=1
    )
    return (found.clearance.lower, found.clearance.upper) if found else ALL


BOXED = Scene(
    structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    absorber=Absorber(mass=0.1, play=3.0, law=Restitution(coefficient=0.5)),
    excitations=[WhiteNoise(intensity=0.2)],
)
"""A loose mass in a box on a mass."""


def vibration_with_an_absorber(seed: int) -> Ends:
    found = partial_answer(
        absorber, BOXED, levels_db=[0.0], rel_error=0.002, budget=0.01, seed=seed, threads=1
    )
    return ends_of(found.central.displacement_std) if found else ALL


TWO_MOTIONS = Scene(
    structure=Oscillator(mass=1.0, damping=0.02, stiffness=0.01),
    impact_pairs=[ImpactPair(clearance=4.0, law=Restitution(coefficient=0.6))],
    excitations=[
        Sine(amplitude=1.0, frequency_hz=1.0 / (2.0 * math.pi)), WhiteNoise(intensity=8e-4)
    ],
)  # fmt: skip
"""A mass that may hit its stops under a sine or not, in noise that ends its rest."""


def life_without_impacts(seed: int) -> Ends:
    found = partial_answer(
        lifetimes, TWO_MOTIONS, ["no impacts"], rel_error=0.01, budget=1.3, seed=seed, threads=1
    ).regimes[0]
    return found.life_time_low, found.life_time_high or math.inf


def exact_rate() -> float:
    return exact(FAR).impact_pairs["stops"]["collision_rate"].value


def exact_hits() -> float:
    return 20.0 * exact(OFTEN).impact_pairs["stops"]["collision_rate"].value


def exact_chance() -> float:
    """The probability of a passage from rest, by the Fokker-Planck equation."""
    passed = first_passage(scene(None), -4.0, 4.0, times=[MISSION])
    return float(passed.probability[-1].value)


def exact_clearance() -> float:
    def beyond(clearance: float) -> float:
        known = exact(scene(clearance, damping=0.05)).impact_pairs["stops"]["collision_rate"]
        return float(known.value) - ACCEPTED

    return float(brentq(beyond, 2.4, 2.9, xtol=1e-6))


def long_vibration() -> float:
    found = absorber(BOXED, levels_db=[0.0], rel_error=0.002, seed=10**6, budget=None)
    return found.central.displacement_std.value


def long_life() -> float:
    found = lifetimes(TWO_MOTIONS, ["no impacts"], rel_error=0.007, seed=10**6, budget=None)
    assert found.regimes[0].life_time is not None
    return found.regimes[0].life_time


def long_bursts() -> float:
    found = reliability(SOFT, mission=10.0, rel_error=0.008, budget=None, seed=10**6, threads=1)
    return found.hits.value


def long_clatter() -> float:
    found = clatter(SOFT, [6e-3], rel_error=0.008, budget=None, seed=10**6, threads=1)
    return float(found["acceleration_rms"].iloc[0])


QUESTIONS: dict[str, tuple[Callable[[int], Ends], Callable[[], float]]] = {
    "rate, simulate": (simulated_rate, exact_rate),
    "deviation, simulate": (simulated_deviation, lambda: 1.0),
    "rate, impacts": (counted_impacts, exact_rate),
    # two-sided S0 / (2 pi b^2) per rad/s at resonance; one-sided per hertz
    "density, spectrum": (sampled_spectrum, lambda: 2.0 * 0.2 / 0.1**2),
    "impacts of missions, reliability": (hits_of_missions, exact_hits),
    "probability by splitting, reliability": (split_chance, exact_chance),
    "impacts of clusters, reliability": (hits_of_bursts, long_bursts),
    "acceleration, clatter": (clatter_of_windows, long_clatter),
    "rate, clearance": (rate_at_a_clearance, exact_rate),
    "clearance, size": (required_clearance, exact_clearance),
    "deviation, absorber": (vibration_with_an_absorber, long_vibration),
    "life, lifetimes": (life_without_impacts, long_life),
}
"""An interval from little work, by seed, and the truth."""

DEAR = (
    "impacts of missions, reliability", "clearance, size", "deviation, absorber", "life, lifetimes"
)  # fmt: skip
"""Questions of which an answer takes a second."""


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [5, pytest.param(200, marks=pytest.mark.verify)])
def test_what_is_left_of_a_budget_holds_as_often_as_it_says(
    seeds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {name: each for name, each in QUESTIONS.items() if seeds > 5 or name not in DEAR}
    truths = {name: truth() for name, (_, truth) in asked.items()}
    tick(monkeypatch, 1e-3)
    held: dict[str, float] = {}
    intervals: list[bool] = []
    for name, (ask, _) in asked.items():
        ends = [ask(seed) for seed in range(seeds)]
        stated = np.mean([low > 0.0 or high < math.inf for low, high in ends])
        assert stated > 0.5, f"{name}: nothing is stated"
        inside = [low <= truths[name] <= high for low, high in ends]
        held[name] = float(np.mean(inside))
        intervals += [hit for hit, (low, _) in zip(inside, ends, strict=True) if low > 0.0]
        assert held[name] > 0.9 - 3.0 * math.sqrt(0.9 * 0.1 / seeds), name
    # upper limits hold more often than they say, intervals as often
    assert len(intervals) > seeds
    assert abs(np.mean(intervals) - 0.95) < 0.02 + 3.0 * math.sqrt(0.05 * 0.95 / len(intervals))


def test_twice_the_error_of_two_paths_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was stated before: the negative control, from the same paths as the upper limits."""
    truth, plain, stated = exact_rate(), 0, 0
    for seed in range(40):
        found = impacts(FAR, paths=2, duration=300.0, seed=seed, threads=1).pairs["stops"]
        rate = found.rates["both"]
        assert rate.estimate.value == 0.0 and rate.estimate.upper_95 == rate.upper
        stated += rate.upper >= truth
        counts = _counts(seed)
        mean, error = mean_and_error(counts / 300.0)
        plain += abs(mean - truth) <= GAUSSIAN_95 * error
    assert stated > 36 > 30 > plain


def _counts(seed: int) -> np.ndarray:
    """Impacts of the same two paths."""
    log = plan_impacts(FAR, duration=300.0).impacts(seed, 0, 2)["stops"]
    return np.bincount(log.path, minlength=2).astype(float)
