"""Spectra, impacts and reliability that go on: the digits of a run that never stopped."""

import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import stochvi.sampling.checkpoints as checkpoints
from stochvi.cli import main
from stochvi.methods.monte_carlo import simulate
from stochvi.results.errors import CheckpointError, NotConverged
from stochvi.results.intervals import PathMoments
from stochvi.sampling.checkpoints import LONG_SECONDS, Checkpoint
from stochvi.sampling.plain_values import digest_of, from_plain, to_plain
from stochvi.sampling.workers import WorkerPool
from stochvi.scenes.excitations import TabulatedNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene, load_scene
from stochvi.scenes.structures import Isolator
from stochvi.statistics.impacts import impacts
from stochvi.statistics.reliability import reliability
from stochvi.statistics.spectra import spectrum
from support.known import oscillator as between_stops

CLOCK = ("cost", "seconds", "crude_seconds", "seconds_per_mission", "call")
"""Keys of documents that hold times and calls, which differ from run to run."""


TOML = """
structure = {kind = "oscillator", mass = 1.0, damping = 0.1, stiffness = 1.0}
[[impact_pair]]
lower = -1.0
upper = 1.0
law = {kind = "restitution", coefficient = 0.8}
[[excitation]]
kind = "white"
intensity = 0.2
"""
"""The file of `oscillator()`."""


def oscillator(restitution: float = 0.8) -> Scene:
    return between_stops(-1.0, 1.0, restitution)


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


RUNS = {
    "spectrum by error": (spectrum, oscillator, {"rel_error": 0.05}),
    "spectrum by paths": (spectrum, oscillator, {"paths": 600, "segment": 60.0}),
    "impacts by error": (impacts, oscillator, {"rel_error": 0.006, "duration": 20.0}),
    "impacts by paths": (impacts, oscillator, {"paths": 3000, "duration": 20.0}),
    "reliability by missions": (
        reliability,
        oscillator,
        {"mission": 100.0, "impact_speed": 2.5, "start": "rest", "rel_error": 0.1},
    ),
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
    process = subprocess.Popen(
        [sys.executable, "-m", "stochvi", *command, "--checkpoint", str(kept),
         "--checkpoint-interval", "0.01"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    deadline = time.monotonic() + 600.0
    while time.monotonic() < deadline and process.poll() is None:
        if kept.exists() and Checkpoint.read(kept).samples:
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL if os.name == "posix" else signal.SIGTERM)
    process.wait()
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
    kept.write_bytes(text.replace(b"checkpoint 5", b"checkpoint 4", 1))
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
    header = f"stochvi checkpoint 5 {hashlib.sha256(body).hexdigest()}\n"
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
