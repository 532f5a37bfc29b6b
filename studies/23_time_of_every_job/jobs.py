"""The jobs that are timed: commands as a user gives them, each on a scene."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from stochvi.scenes.datasets import shipped_scene, zoo_files

QUICK = ("--help", "first answer, compiled", "explain, a table", "R = 1, 1 sigma")
"""Jobs of a shortened run."""


class Job(NamedTuple):
    """A command that ends by itself: what it takes is the CPU time of its whole process."""

    name: str
    words: tuple[str, ...]
    compiled: bool = True


class Engine(NamedTuple):
    """A scene whose step is timed: two runs of different length, and what the longer took more."""

    name: str
    scene: Path
    duration: float
    """Length of a path of the shorter run, s."""


def _job(name: str, command: str, scene: Path | str, *words: str) -> Job:
    return Job(name, (command, str(scene), *words))


def jobs() -> Iterator[Job]:
    """Whole commands, from the shortest to the longest."""
    truck, lossy = shipped_scene("isolator-truck"), shipped_scene("oscillator-lossy")
    zoo = zoo_files()
    first = ("simulate", str(truck), "--rel-error", "0.01", "--seed", "1")
    yield Job("--help", ("--help",))
    yield Job("first answer, compiled", first)
    yield Job("first answer, nothing compiled", first, compiled=False)
    yield _job("explain, a table", "explain", truck)
    yield _job("exact, elastic stops", "exact", shipped_scene("oscillator-elastic"))
    yield _job("linearise, a table", "linearise", truck)
    yield _job("fokker-planck, lossy stops", "fokker-planck", lossy)
    yield _job(
        "sine, 400 frequencies", "sine", shipped_scene("isolator-sine"), "--from", "5", "--to", "30"
    )
    yield _job("spectrum, a table", "spectrum", truck, "--rel-error", "0.1", "--seed", "1")
    yield _job("impacts, a table", "impacts", truck, "--rel-error", "0.02", "--seed", "1")
    yield _job("check, lossy stops", "check", lossy, "--rel-error", "0.01", "--seed", "1")
    yield _job(
        "check, a table", "check", zoo["psd-truck-elastic"], "--rel-error", "0.01", "--seed", "1"
    )
    yield _job(
        "check, three masses",
        "check",
        zoo["chain-lossy-pairs"],
        "--rel-error",
        "0.01",
        "--seed",
        "1",
    )
    mission = ("--mission", "3600", "--rel-error", "0.1", "--seed", "1")
    yield _job("reliability, speed", "reliability", truck, "--impact-speed", "0.5", *mission)
    size = ("--rel-error", "0.05", "--seed", "1")
    yield _job("size --probability", "size", truck, "--probability", "0.01", *size)
    yield _job("size --rate", "size", truck, "--rate", "0.01", *size)
    yield _job("size --impact-speed", "size", truck, "--impact-speed", "0.5", *size)
    yield _job(
        "size --peak-acceleration", "size", shipped_scene("isolator-bumper"),
        "--peak-acceleration", "40g", *size,
    )  # fmt: skip
    yield _job(
        "size --probability, box of six",
        "size",
        shipped_scene("rigid-box"),
        "--probability",
        "0.01",
        *size,
    )
    yield _job(
        "absorber, design", "absorber", shipped_scene("absorber-on-a-tower"),
        "--mass-budget", "100", "--rel-error", "0.03", "--budget", "300", "--seed", "1",
    )  # fmt: skip


def engines() -> Iterator[Engine]:
    """Scenes whose step is timed, each with a length that takes some tenths of a second."""
    zoo = zoo_files()
    for name, file, duration in (
        ("R = 1, 1 sigma", "oscillator-elastic", 2e4),
        ("R = 0.5, 1 sigma", "lossy-0.5", 1e4),
        ("pressed on a lossy stop", "lossy-preload", 5e3),
        ("elastic stops at 2 sigma", "elastic-two-sigma", 2e4),
        ("springs for stops", "spring-stops", 2e3),
        ("a table, elastic stops", "psd-truck-elastic", 100.0),
        ("absorber, lossy", "absorber-lossy", 1e3),
        ("three masses, lossy", "chain-lossy-pairs", 500.0),
    ):
        yield Engine(name, zoo[file] if file in zoo else shipped_scene(file), duration)
