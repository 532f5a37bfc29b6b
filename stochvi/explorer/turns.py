"""One turn of the knobs, answered in three stages: closed forms, a simulation with few paths, and
a refinement. What is looked for first comes first: the linear motion, impacts, the risk.

Every message says by what method its numbers are known, and how well.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from stochvi.explorer.knobs import (
    MISSION,
    PROBABILITY,
    TARGETS,
    checked,
    knobs_of,
    profile_of,
    turned,
)
from stochvi.isolators.screening import at_clearances, screen
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.size import risk_curve
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import record_path, simulate
from stochvi.results.errors import StochviError
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import profiles
from stochvi.scenes.scene import Scene
from stochvi.views.tables import of_less_risk, of_three_sigma, of_your_stops

FEW_PATHS, PATHS = 64, 512
"""Paths of the first simulation of a turn, and of its refinement."""

BUDGET = 20.0
"""Largest time of a part of a turn, s."""

PATIENCE = 0.05
"""Time after which a turn that waits for another one looks whether it is still wanted, s."""

NEAR, FAR, PLACES = 0.8, 7.0, 60
"""Clearances of Rice's curve: their ends in standard deviations, and their number."""

DOTS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
"""Clearances that are simulated, and solved by the closure, in standard deviations."""

LINEAR = "linear motion without stops"

PERIODS, SAMPLES = 40, 40
"""Periods of the motion that moves on the page, and samples in each."""

Message = dict[str, Any]


class Stale(Exception):
    """A later turn of the same tab has come, and nobody waits for this one."""


class Refused(Exception):
    """What a message asks, or a scene does not allow, in a sentence for the page."""

    def __init__(self, sentence: str, id: Any = None) -> None:
        super().__init__(sentence)
        self.id = id


@dataclass(eq=False)
class Turn:
    """A scene whose knobs are turned, and the question. `stale` is set by a later turn."""

    scene: Scene
    mission: float
    probability: float
    seed: int
    id: int
    stale: threading.Event = field(default_factory=threading.Event)

    def stages(self) -> Iterator[Message]:
        """The messages of the three stages, each part computed when it is asked for."""
        for stage, part in (
            ("closed", self.linear), ("simulated", self.rate), ("simulated", self.risk),
            ("closed", self.closure), ("simulated", self.motion), ("refined", self.finer_rate),
            *(("refined", self.dot(share)) for share in DOTS),
        ):  # fmt: skip
            if self.stale.is_set():
                return
            try:
                found = part()
            except Stale:
                return
            except (StochviError, ValueError) as reason:
                found = {"part": part.__name__, "missing": str(reason)}
            yield {"type": "answer", "id": self.id, "stage": stage, **found}
        yield {"type": "done", "id": self.id}

    def _look(self, *_: Any) -> None:
        """As the progress of a calculation it ends one for which nobody waits."""
        if self.stale.is_set():
            raise Stale

    def linear(self) -> Message:
        """The linear motion, and Rice's rate of crossings over clearance."""
        linear = screen(self.scene)
        gap = linear.impact_pairs[self.pair]
        sigma = gap.displacement_std
        places = np.linspace(NEAR * sigma, FAR * sigma, PLACES)
        rates = [gap.rate_at(float(each)) for each in places]
        return {
            "part": "linear",
            "numbers": [
                stated("rms displacement", sigma, "m", LINEAR),
                stated("usual rule: three sigma", gap.three_sigma, "m", LINEAR),
                stated("usual rule: impact rate by Rice", gap.rice_rate, "1/s", LINEAR),
            ],
            "three_sigma": gap.three_sigma,
            "clearances": places.tolist(),
            "rice": rates,
            "rice_probability": [-math.expm1(-each * self.mission) for each in rates],
        }  # fmt: skip

    def closure(self) -> Message:
        """The impact rate by the moment closure, with its bound."""
        found = linearise(self.scene, budget=BUDGET).impact_pairs[self.pair].collision_rate
        return {"part": "closure", "numbers": [of("impact rate by the closure", found, "1/s")]}

    def rate(self) -> Message:
        """Impacts on the stops, simulated with few paths."""
        return {"part": "rate", **self._simulated(FEW_PATHS)}

    def finer_rate(self) -> Message:
        """The same with more paths."""
        return {"part": "rate", **self._simulated(PATHS)}

    def _simulated(self, paths: int) -> Message:
        found = simulate(
            self.scene, paths=paths, seed=self.seed, budget=BUDGET, progress=self._look
        )
        pair = found.impact_pairs[self.pair]
        numbers = [
            of("simulated impact rate", pair.collision_rate, "1/s"),
            of("mean impact speed", pair.impact_speed_mean, "m/s"),
        ]
        return {"numbers": [each for each in numbers if each], "paths": paths}

    def risk(self) -> Message:
        """The probability of any impact over clearance, and the clearance that keeps the target."""
        found = risk_curve(
            self.scene, probability=self.probability, mission=self.mission, seed=self.seed,
            budget=BUDGET, progress=self._look,
        )  # fmt: skip
        assert isinstance(found, Sizing), "a scene with phases is refused by the explorer"
        clearance = found.clearance
        curve = found.curve[["clearance", "probability", "probability_low", "probability_high"]]
        required = {
            "name": "required clearance", "unit": "m", "value": clearance.value,
            "low": clearance.lower, "high": clearance.upper, "method": found.method,
        }  # fmt: skip
        lines = [*of_your_stops(found), of_three_sigma(found), *of_less_risk(found)]
        return {"part": "risk", "numbers": [required], "sentence": found.verdict(), "lines": lines,
                "curve": {name: finite(column) for name, column in curve.items()}}  # fmt: skip

    def motion(self) -> Message:
        """A piece of one simulated path, for the moving picture."""
        frequency = screen(self.scene).impact_pairs[self.pair]
        omega = frequency.velocity_std / frequency.displacement_std
        period = 2.0 * math.pi / omega
        path = record_path(
            self.scene, duration=PERIODS * period, step=period / SAMPLES, seed=self.seed,
            budget=BUDGET,
        )  # fmt: skip
        names = ("time", "displacement", "impact_speed")
        return {"part": "motion", "path": {name: finite(path[name]) for name in names}}

    def dot(self, share: float) -> Any:
        """What gives the impact rate by the closure and by simulation at a clearance."""

        def part() -> Message:
            clearance = share * screen(self.scene).impact_pairs[self.pair].displacement_std
            there = at_clearances(self.scene, clearance)
            found: Message = {"part": "dot", "clearance": clearance}
            with contextlib.suppress(StochviError):
                closure = linearise(there, budget=BUDGET).impact_pairs[self.pair].collision_rate
                found["closure"] = of("closure", closure, "1/s")
            simulated = simulate(
                there, paths=FEW_PATHS, seed=self.seed, budget=BUDGET, progress=self._look
            )
            rate = simulated.impact_pairs[self.pair].collision_rate
            return found | {"simulated": of("simulated", rate, "1/s")}

        return part

    @property
    def pair(self) -> str:
        """The name of its pair."""
        return self.scene.expanded.impact_pairs[0].name


def stated(name: str, value: float, unit: str, method: str) -> Message:
    """A number that is known exactly, for the page."""
    return {"name": name, "unit": unit, "value": value, "method": method}


def of(name: str, estimate: Estimate | None, unit: str) -> Message | None:
    """An estimate with its 95 % interval, bias included, for the page."""
    if estimate is None or math.isnan(estimate.value):
        return None
    half = estimate.half_width_95()
    low, high = max(estimate.value - half, 0.0), estimate.value + half
    if estimate.upper_95 is not None:
        low, high = 0.0, estimate.upper_95
    return {"name": name, "unit": unit, "value": estimate.value, "method": estimate.how,
            "low": low, "high": high}  # fmt: skip


def finite(column: Any) -> list[float | None]:
    """Numbers as JSON holds them."""
    return [float(each) if math.isfinite(each) else None for each in column]


class Explorer:
    """A scene, and the turns of those who explore it.

    Raises `ValueError` for a scene that the page does not show.
    """

    def __init__(self, scene: Scene, seed: int = 0) -> None:
        if len(scene.expanded.impact_pairs) != 1 or scene.phases:
            raise ValueError("explore shows a scene with one impact_pair and without phases")
        self.scene, self.seed = scene, seed
        self.latest: dict[str, Turn] = {}
        self.work = threading.Lock()  # kernels use all cores already

    def warm_up(self) -> None:
        """Compile what a turn needs, before the first one asks for it."""
        for _ in self._worked(Turn(self.scene, MISSION.value, PROBABILITY.value, self.seed, 0)):
            pass

    def answers(self, message: Any) -> Iterator[Message]:
        """The messages that answer one of the page; `ValueError` for one of no known shape."""
        if not isinstance(message, dict) or message.get("type") not in ("open", "turn"):
            raise ValueError("type must be open or turn")
        if message["type"] == "open":
            return iter([self.opening()])
        return self._turn(message)

    def opening(self) -> Message:
        """The knobs, and what else the page begins with."""
        profile = profile_of(self.scene)
        return {
            "type": "knobs",
            "title": self.scene.title,
            "knobs": [each._asdict() for each in (*knobs_of(self.scene), *TARGETS)],
            "profile": profile,
            "profiles": [*profiles()] if profile else [],
        }

    def _turn(self, message: Mapping[str, Any]) -> Iterator[Message]:
        values, tab, number = message.get("values"), message.get("tab"), message.get("id")
        if not isinstance(values, dict) or len(values) > 200 or type(number) is not int:
            raise ValueError("a turn must have values, and a whole number for its id")
        if not isinstance(tab, str) or len(tab) > 40:
            raise ValueError("tab must be a short text")
        profile = message.get("profile")
        if profile is not None and not isinstance(profile, str):
            raise ValueError("profile must be a text")
        return self._stages(dict(values), profile, tab, number)

    def _stages(
        self, values: dict[str, Any], profile: str | None, tab: str, number: int
    ) -> Iterator[Message]:
        try:
            mission, probability = (
                checked(knob, knob.key, values.pop(knob.key, knob.value)) for knob in TARGETS
            )
            scene = turned(self.scene, values, profile)
            turn = Turn(scene, mission, probability, seed=self.seed, id=number)
        except ValueError as reason:
            raise Refused(str(reason), number) from reason
        before = self.latest.get(tab)
        if before is not None and before.id > number:  # requests may overtake each other
            return
        if before is not None:
            self.latest.pop(tab).stale.set()
        self.latest[tab] = turn
        while len(self.latest) > 64:
            self.latest.pop(next(iter(self.latest))).stale.set()
        yield from self._worked(turn)

    def _worked(self, turn: Turn) -> Iterator[Message]:
        """The messages of a turn, one turn at work at a time.

        The first needs no kernel, and waits for no other turn.
        """
        stages = turn.stages()
        yield from islice(stages, 1)
        while True:
            while not self.work.acquire(timeout=PATIENCE):
                if turn.stale.is_set():  # else those who turn fast leave a queue behind them
                    return
            try:
                found = next(stages, None)
            finally:
                self.work.release()
            if found is None:
                return
            yield found
