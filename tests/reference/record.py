"""Record what every sampler answers: `python tests/reference/record.py digits|accurate`.

`digits` writes the numbers of short runs with fixed seeds, `accurate` the answers of `simulate` to
the whole zoo. Both go on where they ended: a case that stands in the file already is not run again.
"""

from __future__ import annotations

import argparse
import csv
import fcntl
import hashlib
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import stochvi
from stochvi.absorbers.design import design_absorber
from stochvi.absorbers.performance import absorber
from stochvi.isolators.sizing.review import clatter
from stochvi.isolators.sizing.risk_curve import chance_in_windows
from stochvi.methods.monte_carlo import record_path
from stochvi.methods.periodic.attracted import basins
from stochvi.scenes.datasets import shipped_scene, zoo_files
from stochvi.statistics.clusters import bursts
from stochvi.statistics.crossings import first_crossings
from stochvi.statistics.lifetimes import lifetimes
from stochvi.statistics.rare_hits import rare_hits
from stochvi.sweeps import sweep
from stochvi.verification.cost import cost

HERE = Path(__file__).parent

CLOCK = {
    "cost", "seconds", "crude_seconds", "seconds_per_mission", "call", "provenance", "cpu_seconds",
    "wall_time", "threads",
}  # fmt: skip
"""Keys of documents that hold times, calls and machines."""

QUOTES = ("'", '"')
"""First characters of a text as `repr` writes it."""

SHOWN = 24
"""Number of values of a case that are written beside its digest."""

BUDGET = 100.0
"""Seconds for one scene of the zoo; what it reached by then stands in the file."""


def zoo(name: str) -> stochvi.Scene:
    """A scene of the zoo."""
    return stochvi.load_scene(zoo_files()[name])


def shipped(name: str) -> stochvi.Scene:
    """A scene that comes with the package."""
    return stochvi.load_scene(shipped_scene(name))


def noisy_sine() -> stochvi.Scene:
    """The mount under a sine, with noise that lets it leave its regimes."""
    quiet = shipped("isolator-sine")
    return quiet.replace(excitations=(*quiet.excitations, stochvi.WhiteNoise(intensity=0.1)))


def far() -> stochvi.Scene:
    """An oscillator whose elastic stops are hit now and then."""
    stops = stochvi.ImpactPair(lower=-2.5, upper=2.5, law=stochvi.Elastic(stiffness=20.0))
    return zoo("linear").replace(impact_pairs=(stops,))


def on_a_structure() -> stochvi.Scene:
    """A lightly damped oscillator that may carry an absorber."""
    return stochvi.Scene(
        structure=stochvi.Oscillator(mass=1.0, damping=0.02, stiffness=1.0),
        excitations=[stochvi.WhiteNoise(intensity=0.04)],
    )


PLANS = {
    "white elastic": ("elastic-box", {}),
    "white lossy": ("lossy-0.5", {}),
    "white slow impacts": ("lossy-0.3", {"slow_impacts": True}),
    "white linear": ("linear", {}),
    "compliant": ("spring-stops", {}),
    "hertz": ("hertz-stops", {}),
    "tabulated": ("psd-truck-elastic", {}),
    "tabulated contacts": ("psd-spring-stops", {}),
    "modal": ("absorber-lossy", {}),
    "modal contacts": ("chain-elastic-stops", {}),
    "two pairs": ("chain-two-pairs", {}),
    "filtered": ("filtered-lossy", {}),
    "sine on random": ("sine-on-random", {}),
}
"""Scenes of the zoo that between them call for every plan."""

BY_ERROR = ("elastic-box", "lossy-0.5", "spring-stops", "psd-truck-elastic", "absorber-lossy")
"""Scenes that are simulated to a relative error too."""


def cases() -> dict[str, Callable[[], Any]]:
    """Every case by its name."""
    found: dict[str, Callable[[], Any]] = {}
    for name, (scene, asked) in PLANS.items():
        found[f"simulate {name}, paths"] = lambda s=scene, a=asked: stochvi.simulate(
            zoo(s), paths=300, seed=7, budget=None, **a
        )
    found["simulate box on tables, paths"] = lambda: stochvi.simulate(
        shipped("rigid-box"), paths=64, duration=2.0, seed=7, budget=None
    )
    for scene in BY_ERROR:
        found[f"simulate {scene}, rel_error"] = lambda s=scene: stochvi.simulate(
            zoo(s), rel_error=0.02, seed=7, budget=None
        )
    found |= {
        "record_path": lambda: record_path(zoo("lossy-0.5"), duration=20.0, seed=7),
        "history": lambda: stochvi.history(zoo("lossy-0.5"), duration=20.0, seed=7).to_frame(),
        "spectrum welch, paths": lambda: stochvi.spectrum(zoo("lossy-0.5"), paths=300, seed=7),
        "spectrum multitaper, paths": lambda: stochvi.spectrum(
            zoo("psd-truck-elastic"), paths=64, method="multitaper", seed=7, budget=None
        ),
        "spectrum, rel_error": lambda: stochvi.spectrum(zoo("linear"), rel_error=0.05, seed=7),
        "impacts, paths": lambda: stochvi.impacts(
            zoo("lossy-0.5"), paths=3000, duration=20.0, seed=7, budget=None
        ),
        "impacts, rel_error": lambda: stochvi.impacts(
            zoo("chain-two-pairs"), rel_error=0.1, seed=7, budget=None
        ),
        "impacts of a table, first hits": lambda: stochvi.impacts(
            zoo("psd-truck-elastic"), paths=256, first_hits=True, seed=7, budget=None
        ),
        "bursts": lambda: _columns(bursts(far(), rel_error=0.3, seed=7, budget=None)),
        "bursts of a structure": lambda: _columns(
            bursts(shipped("rigid-box"), rel_error=0.4, seed=7, budget=None)
        ),
        "first crossings": lambda: _ages(
            first_crossings(zoo("linear"), [2.5], rel_error=0.1, seed=7, budget=None)
        ),
        "pair crossings": lambda: _ages(
            first_crossings(shipped("rigid-box"), mission=60.0, rel_error=0.2, seed=7, budget=None)
        ),
        "rare hits": lambda: rare_hits(
            zoo("psd-spring-stops"), "impact_speed", 0.5, mission=60.0, rel_error=0.3, seed=7,
            budget=None,
        ),
        "chance in windows": lambda: chance_in_windows(
            zoo("psd-spring-stops"), "impact_speed", 0.5, 60.0, accepted=0.2, seed=7, budget=None
        ),
        "reliability crude and splitting": lambda: stochvi.reliability(
            zoo("lossy-upper-stop"), mission=30.0, impact_speed=3.0, start="rest", rel_error=0.2,
            seed=7, budget=None,
        ),
        "reliability splitting": lambda: stochvi.reliability(
            zoo("linear"), mission=60.0, barrier=5.0, start="rest", rel_error=0.3, seed=7,
            budget=None,
        ),
        "reliability by crossings": lambda: stochvi.reliability(
            zoo("psd-truck-elastic"), mission=600.0, impact_speed=0.4, rel_error=0.3, seed=7,
            budget=None,
        ),
        "reliability of pairs": lambda: stochvi.reliability(
            shipped("rigid-box"), mission=60.0, rel_error=0.3, seed=7, budget=None
        ),
        "cost": lambda: _errors(cost(zoo("lossy-0.5"), paths=1024, seed=7)),
        "clatter": lambda: clatter(
            zoo("psd-spring-stops"), [6e-3], rel_error=0.1, seed=7, budget=None
        ),
        "life times": lambda: lifetimes(
            noisy_sine(), ["no impacts"], rel_error=0.3, seed=7, budget=600.0
        ),
        "basins": lambda: basins(
            shipped("isolator-sine"),
            {
                "displacement.x": np.linspace(-4e-4, 4e-4, 12),
                "velocity.x": np.linspace(-0.3, 0.3, 12),
            },
        ),
        "absorber": lambda: absorber(
            shipped("absorber-on-a-tower"), levels_db=[-3.0, 0.0], rel_error=0.1, seed=7,
            budget=None,
        ),
        "absorber design": lambda: design_absorber(
            on_a_structure(), mass_budget=0.1, restitutions=[0.5], plays=[1, 2, 4, 8],
            rel_error=0.3, seed=7, budget=None,
        ),
        "sweep": lambda: sweep(
            zoo("lossy-0.5"), {"structure.damping": [0.1, 0.2]}, method="simulate", paths=256,
            seed=7,
        ),
    }  # fmt: skip
    return found


def _columns(found: Any) -> dict[str, Any]:
    return {
        name: np.asarray(getattr(found, name))
        for name in ("path", "weight", "early_hits", "hits", "speeds", "fastest", "sharpest")
    }


def _ages(found: Any) -> dict[str, Any]:
    return {"rate": found.first_rate()[0], "ages": found.ages}


def _errors(found: Any) -> list[list[Any]]:
    return [[e.quantity, e.step, e.value, e.standard_error, e.step_bias] for e in found.errors]


def numbers(answer: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of all that an answer holds, without what a clock or a machine decides."""
    if isinstance(answer, pd.DataFrame):
        answer = {str(name): column.to_numpy() for name, column in answer.items()}
    if hasattr(answer, "to_dict"):
        answer = answer.to_dict()
    elif hasattr(answer, "__dataclass_fields__"):
        answer = {name: getattr(answer, name) for name in answer.__dataclass_fields__}
    if isinstance(answer, dict):
        for name, each in answer.items():
            if name not in CLOCK:
                for below, value in numbers(each):
                    yield f"{name}.{below}".rstrip("."), value
    elif isinstance(answer, np.ndarray) and answer.dtype != object:
        yield "", hashlib.sha256(np.ascontiguousarray(answer).tobytes()).hexdigest()[:16]
        if answer.size and answer.dtype.kind == "f":
            yield "mean", repr(float(np.mean(answer, dtype=float)))
    elif isinstance(answer, list | tuple | np.ndarray):
        for number, each in enumerate(answer):
            for below, value in numbers(each):
                yield f"{number}.{below}".rstrip("."), value
    elif isinstance(answer, float | int | str | bool | None):
        yield "", repr(float(answer)) if isinstance(answer, float) else repr(answer)


def digits_of(case: Callable[[], Any]) -> dict[str, Any]:
    """Digest of all numbers of a case, and the first of them that are not 0: sentences may be
    written anew."""
    every = [(name, value) for name, value in numbers(case()) if not value.startswith(QUOTES)]
    text = "\n".join(f"{name} {value}" for name, value in every)
    values = {
        name: value
        for name, value in every
        if not name.startswith(("scene", "frequency")) and value not in ("None", "0.0")
    }  # fmt: skip
    shown = dict(list(values.items())[:SHOWN])
    return {"digest": hashlib.sha256(text.encode()).hexdigest()[:24], "values": shown}


def record_digits(target: Path, chosen: str) -> None:
    """Run the cases that the file does not hold."""
    from stochvi.sampling.workers import machine

    known = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    known["machine"] = machine()
    for name, case in cases().items():
        if name in known or chosen not in name:
            continue
        began = time.perf_counter()
        known[name] = digits_of(case)
        print(f"{time.perf_counter() - began:7.2f} s  {name}", flush=True)
        target.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")


@contextmanager
def alone(lock: Path | None) -> Iterator[None]:
    """Hold a lock on a file, if there is one, while a scene is simulated."""
    if lock is None:
        yield
        return
    with lock.open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


COLUMNS = (
    "scene", "of", "quantity", "value", "standard_error", "bias", "bias_error", "paths", "seconds",
)  # fmt: skip


def _written(number: float | None) -> str:
    """A number with all its digits."""
    return repr(None if number is None else float(number))


def record_accurate(target: Path, rel_error: float, budget: float, lock: Path | None) -> None:
    """Simulate the scenes that the file does not hold."""
    known = set()
    if target.exists():
        with target.open(encoding="utf-8") as file:
            known = {row["scene"] for row in csv.DictReader(file)}
    else:
        target.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    for name, file in sorted(zoo_files().items()):
        if name in known:
            continue
        began = time.perf_counter()
        with alone(lock):
            try:
                answer = stochvi.simulate(
                    stochvi.load_scene(file), rel_error=rel_error, seed=2024, budget=budget
                )
            except stochvi.NotConverged as short:
                answer = short.response
        if answer is None:
            continue
        rows = [
            (name, of, quantity, *map(_written, (each.value, each.standard_error, each.bias,
             each.bias_error)), answer.cost.paths, f"{answer.cost.wall_time:.1f}")
            for (of, quantity), each in answer.estimates().items()
            if each.upper_95 is None  # what was never seen has no error
        ]  # fmt: skip
        with target.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
        print(f"{time.perf_counter() - began:7.2f} s  {name}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["digits", "accurate"])
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--only", default="", help="part of the names of the cases")
    parser.add_argument("--rel-error", type=float, default=0.001)
    parser.add_argument("--budget", type=float, default=BUDGET)
    parser.add_argument("--lock", type=Path)
    options = parser.parse_args()
    if options.what == "digits":
        record_digits(options.out / "digits.json", options.only)
    else:
        record_accurate(
            options.out / "accurate.csv", options.rel_error, options.budget, options.lock
        )
