"""Where a checkpoint may be written, what it may replace, and what is no end of a run."""

import errno
import hashlib
import json
import math
import os
import sys
import threading
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import stochvi.sampling.checkpoints as checkpoints
from stochvi.cli import main
from stochvi.methods.monte_carlo import simulate
from stochvi.results.atomic_files import write_whole
from stochvi.results.errors import CheckpointError, Interrupted, NotConverged
from stochvi.sampling.checkpoints import LONG_SECONDS, Checkpoint
from stochvi.scenes.excitations import WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator

ASKED = {"paths": 64, "duration": 10.0, "seed": 4}


def oscillator() -> Scene:
    pair = ImpactPair(lower=-1.0, upper=1.0, law=Restitution(coefficient=1.0))
    return Scene(
        structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
        impact_pairs=[pair],
        excitations=[WhiteNoise(intensity=0.2)],
    )


def paths_in(kept: Path) -> int:
    return sum(each.paths for each in Checkpoint.read(kept).samples.values())


# ---- what is there ----------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the file system has no named pipes")
def test_nothing_but_a_checkpoint_is_replaced(tmp_path: Path) -> None:
    scene_file, fifo = tmp_path / "scene.toml", tmp_path / "fifo"
    scene_file.write_text("[structure]\n")
    os.mkfifo(fifo)
    (tmp_path / "link").symlink_to(scene_file)
    for there in (scene_file, fifo, tmp_path / "link"):
        with pytest.raises(CheckpointError, match="is no checkpoint of stochvi; name another file"):
            simulate(oscillator(), **ASKED, checkpoint=there)
        if there != fifo:
            assert there.read_text() == "[structure]\n"
    assert fifo.is_fifo() and (tmp_path / "link").is_symlink()
    with pytest.raises(CheckpointError, match="is a folder; name a file in it"):
        simulate(oscillator(), **ASKED, checkpoint=tmp_path)
    for there in (fifo, tmp_path):  # nor is one read
        with pytest.raises(CheckpointError, match="is not a checkpoint of stochvi"):
            simulate(oscillator(), resume=there)
    for name in ("checkpoint", "resume"):
        with pytest.raises(ValueError, match=f"{name} must name a file, got ''"):
            simulate(oscillator(), **ASKED, **{name: ""})


def test_a_link_is_followed_and_an_empty_file_is_filled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # else a busy machine, on which a run takes longer, keeps the checkpoint as `there.earlier`
    monkeypatch.setattr(checkpoints, "LONG_SECONDS", math.inf)
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "there")
    (tmp_path / "empty").touch()
    for kept in (link, link, tmp_path / "empty"):  # the second time there is a checkpoint
        simulate(oscillator(), **ASKED, checkpoint=kept)
        assert paths_in(kept) == 64
    assert link.is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["empty", "link", "there"]


def test_what_took_long_is_kept_as_earlier(tmp_path: Path) -> None:
    kept, earlier = tmp_path / "run", tmp_path / "run.earlier"

    def rerun(seconds: float) -> None:
        """After a run that took so long."""
        simulate(oscillator(), **ASKED, checkpoint=kept)
        found = Checkpoint.read(kept)
        found.seconds = seconds
        found.write()
        simulate(oscillator(), **ASKED, checkpoint=kept)

    rerun(0.5 * LONG_SECONDS)
    assert not earlier.exists()
    for seconds, longest in ((3.0, 3.0), (2.0, 3.0), (4.0, 4.0)):
        rerun(seconds * LONG_SECONDS)
        assert Checkpoint.read(earlier).seconds == longest * LONG_SECONDS
    assert Checkpoint.read(kept).seconds < LONG_SECONDS
    simulate(oscillator(), resume=earlier)  # that goes on is no new run: it stays where it is
    assert earlier.exists()


def test_two_runs_on_one_checkpoint_do_not_end_each_other(tmp_path: Path) -> None:
    ended = []

    def run() -> None:
        simulate(
            oscillator(), paths=8000, duration=10.0, threads=1, checkpoint=tmp_path / "run",
            checkpoint_interval=1e-4,
        )  # fmt: skip
        ended.append(paths_in(tmp_path / "run"))

    both = [threading.Thread(target=run) for _ in range(2)]
    for each in both:
        each.start()
    for each in both:
        each.join()
    assert len(ended) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


# ---- a disk that fills up ---------------------------------------------------------------------


class FullDisk:
    """Stands for `write_whole`: it works so often, and then there is no room."""

    def __init__(self, writes: int) -> None:
        self.left = writes

    def __call__(self, data: bytes, path: Path, *, durable: bool = False) -> None:
        self.left -= 1
        if self.left < 0:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write_whole(data, path, durable=durable)


def test_a_disk_that_fills_up_costs_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def warned(response) -> bool:
        return any("run could not be written: no space left" in each for each in response.warnings)

    def interrupts(done: float, text: str) -> None:
        raise KeyboardInterrupt

    kept = tmp_path / "run"
    fine = simulate(oscillator(), **ASKED, checkpoint=kept)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    full = simulate(oscillator(), **ASKED, checkpoint=kept)
    assert warned(full) and not warned(fine)
    assert full.coordinates == fine.coordinates
    assert paths_in(kept) == 0  # whole, as it was first written
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    with pytest.raises(Interrupted) as stopped:
        simulate(oscillator(), **ASKED, checkpoint=kept, progress=interrupts)
    assert stopped.value.partial.interrupted and warned(stopped.value.response)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=1))
    with pytest.raises(NotConverged) as short:
        simulate(oscillator(), rel_error=1e-4, budget=1e-3, checkpoint=kept)
    assert warned(short.value.partial)
    monkeypatch.setattr(checkpoints, "write_whole", FullDisk(writes=0))
    with pytest.raises(CheckpointError, match=r"run cannot be written: no space left"):
        simulate(oscillator(), **ASKED, checkpoint=kept)


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"nope/run cannot be written: no such file"):
        simulate(oscillator(), **ASKED, checkpoint=tmp_path / "nope" / "run")


# ---- what is asked, and what was written ------------------------------------------------------


def test_the_price_of_more_accuracy_counts_the_time_before_a_resume(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), checkpoint=kept, **ASKED)
    cost = simulate(oscillator(), resume=kept, **ASKED).cost
    assert cost.tenfold_wall_time == pytest.approx(100.0 * cost.wall_time)


def test_numbers_of_numpy_are_numbers(tmp_path: Path) -> None:
    asked = {"paths": np.int64(64), "duration": np.float32(10.0), "seed": np.int64(4)}
    numpy = simulate(oscillator(), **asked, checkpoint=tmp_path / "run")
    assert numpy.coordinates == simulate(oscillator(), **ASKED).coordinates
    assert simulate(oscillator(), resume=tmp_path / "run", **asked).cost.paths == 64
    simulate(oscillator(), rel_error=np.float32(0.2), checkpoint=tmp_path / "other")
    for wrong in (64.0, np.float64(64.0)):
        with pytest.raises(ValueError, match="paths must be a whole number"):
            simulate(oscillator(), paths=wrong)


def test_another_format_and_missing_keys_are_said(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), **ASKED, checkpoint=kept)
    text = kept.read_bytes()
    kept.write_bytes(text.replace(b"checkpoint 5", b"checkpoint 12", 1))
    with pytest.raises(CheckpointError, match=r"another version of stochvi \(format 12, here 5\)"):
        simulate(oscillator(), resume=kept)
    whole = json.loads(text.partition(b"\n")[2])
    ((name, entry),) = whole["samples"].items()
    fields = entry["sample"]["fields"]
    for document in (
        {"scene": {}},
        [],
        whole | {"more": 1},
        whole | {"scene": [1]},
        whole | {"proof": None},
        whole | {"seconds": -1.0},
        {key: whole[key] for key in whole if key != "samples"},
        *(
            whole | {"samples": {name: changed}}
            for changed in (
                {key: entry[key] for key in entry if key != "paths"},
                entry | {"paths": "64"},
                entry | {"paths": True},
                entry | {"paths": -1},
                entry | {"goal": 1e3},
                entry | {"machines": "abc"},
                entry | {"more": 1},
                entry | {"sample": {"record": "os:system", "fields": {}}},
                entry | {"sample": entry["sample"] | {"fields": {"fine": fields["fine"]}}},
            )
        ),
    ):
        body = json.dumps(document).encode()
        header = f"stochvi checkpoint 5 {hashlib.sha256(body).hexdigest()}\n".encode()
        kept.write_bytes(header + body)
        with pytest.raises(CheckpointError, match="does not hold what a checkpoint"):
            simulate(oscillator(), resume=kept)
    nested = b'{"scene": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    for body in (nested, b"{", b"\xff", text.partition(b"\n")[2].replace(b"0.", b"NaN, 0.", 1)):
        digest = hashlib.sha256(body).hexdigest()
        kept.write_bytes(f"stochvi checkpoint 5 {digest}\n".encode() + body)
        with pytest.raises(CheckpointError, match="does not hold what a checkpoint"):
            simulate(oscillator(), resume=kept)


def test_a_damaged_checkpoint_is_kept_aside_with_a_word(tmp_path: Path) -> None:
    kept = tmp_path / "run"
    simulate(oscillator(), **ASKED, checkpoint=kept)
    cut = kept.read_bytes()[:-100]
    kept.write_bytes(cut)
    with pytest.warns(UserWarning, match=r"run is damaged.*renamed to run\.damaged"):
        simulate(oscillator(), **ASKED, checkpoint=kept)
    assert (tmp_path / "run.damaged").read_bytes() == cut
    assert paths_in(kept) == 64


# ---- executors that are none, and Ctrl-C ------------------------------------------------------


class Refuses(Executor):
    def __init__(self, error: Exception) -> None:
        self.error = error

    def submit(self, *arguments):
        raise self.error


class Forgets(ThreadPoolExecutor):
    def submit(self, *arguments):
        return super().submit(lambda: None)


@pytest.mark.parametrize("error", [OSError("a"), ConnectionError("b"), ValueError("c")])
def test_an_executor_that_takes_no_work_is_said(error: Exception) -> None:
    with pytest.raises(NotConverged, match=f"takes no more work \\({type(error).__name__}: "):
        simulate(oscillator(), **ASKED, executor=Refuses(error))


def test_what_is_no_executor_or_gives_no_answer_is_said() -> None:
    with pytest.raises(ValueError, match=r"executor must be a concurrent.futures.Executor.* got 4"):
        simulate(oscillator(), **ASKED, executor=4)
    with Forgets(1) as executor, pytest.raises(NotConverged, match="returned NoneType, not"):
        simulate(oscillator(), **ASKED, executor=executor)


SCENE = """\
[structure]
kind = "oscillator"
mass = 1.0
damping = 0.1
stiffness = 1.0
[[impact_pair]]
upper = 1.0
law = { kind = "restitution", coefficient = 1.0 }
[[excitation]]
kind = "white"
intensity = 0.2
"""


def interrupts(*arguments: object, **named: object) -> None:
    raise KeyboardInterrupt


def test_control_c_while_the_code_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    kept = tmp_path / "run"
    # the package's `simulate` is the function
    monkeypatch.setattr(sys.modules["stochvi.methods.monte_carlo.simulate"], "compiled", interrupts)
    with pytest.raises(Interrupted, match="before any path") as stopped:
        simulate(oscillator(), **ASKED)
    assert stopped.value.partial is None
    ask = ["simulate", str(tmp_path / "scene.toml"), "--paths", "64", "--checkpoint", str(kept)]
    done = CliRunner().invoke(main, ask)
    assert done.exit_code == 1 and done.stdout == ""
    said = "stochvi: interrupted by Ctrl-C before any path was simulated"
    assert done.stderr == f"{said}; go on with --resume {kept}\n"
    monkeypatch.undo()
    assert CliRunner().invoke(main, [*ask[:2], "--resume", str(kept)]).exit_code == 0


@pytest.mark.parametrize(
    ("command", "method"),
    [
        ("check", "stochvi.verification.check.check"),
        ("spectrum", "stochvi.statistics.spectra.spectrum"),
        ("impacts", "stochvi.statistics.impacts.impacts"),
        ("damage --mission 10", "stochvi.statistics.damage.damage"),
        ("reliability --mission 10", "stochvi.statistics.reliability.reliability"),
    ],
)
def test_control_c_ends_a_command_with_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, method: str
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    monkeypatch.setattr(method, interrupts)
    done = CliRunner().invoke(main, [*command.split(), str(tmp_path / "scene.toml")])
    assert (done.exit_code, done.stdout) == (1, "")
    assert done.stderr == "stochvi: interrupted by Ctrl-C; nothing was kept\n"
