"""What the page asks, and how it is answered.

A turn of the knobs is answered in three stages: closed forms, a simulation with few paths, and a
refinement. What is looked for first comes first: the linear motion, impacts, the risk. Every number
says by what method it is known, and how well.

The page sends objects with a `type`. A kernel or a server answers each by objects with a `type`.
Each has the `id` of its message, a whole number. `tab`, a short text, stands for the page that
asks. Lengths and all else are in SI units. A setting is `values`, numbers by the keys of knobs. It
may have `preset`, `profile` and `law`, names that the answer to open lists. It may have `psd`, the
text of a table.

| message | what it has | answers |
|---|---|---|
| open | a setting | knobs |
| turn | a setting | answer for each part, then done; a turn ends that before it |
| confirm | a setting | progress (`done`, 0 to 1, `words`), answer of the part confirmed, done |
| cancel | | done; it ends what the tab confirms, and the file that it makes |
| take | a setting, and `what`, one of the `offers` | file (`name`, `media`, `text`) |
| price | a setting, and a grid as `what` | priced (`designs`, `seconds`, `bytes`) |
| page | the same | progress, file: the page with stored turns |

- knobs has `title`, `kind` (pair, box, absorber, sine), `preset`, `presets`, `offers`.
- Its `knobs` and `tolerances` have `key`, `words`, `unit`, `value`, `low`, `high`, `logarithmic`.
- Its choices are `profile`, `profiles`, `takes_table`, `law`, `laws`.
- A grid has `knobs`, lists of keys that move together, and `steps`, the number of their values.
- answer has its `stage` (closed, simulated, refined), its `part`, and `numbers`, or else `missing`.
  `next` says what is computed after it, `short` why it is less exact than was asked.

What cannot be is answered by refused, with a `sentence`.
"""

from __future__ import annotations

import contextlib
import json
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest
from typing import Any

import numpy as np

from stochvi.absorbers.performance import absorber
from stochvi.explorer.knobs import (
    PRESETS,
    Design,
    Setting,
    chosen,
    design_of,
    kind_of,
    knobs_of,
    laws_of,
    profile_of,
    questions_of,
    takes_table,
)
from stochvi.explorer.onefile import Grid, page_of, stored
from stochvi.explorer.takeaways import (
    CommandLine,
    frequency_of,
    offers_of,
    question_of,
    taken,
)
from stochvi.isolators.bumpers import bumper_map
from stochvi.isolators.screening import (
    GapScreening,
    Screening,
    at_clearances,
    environment,
    screen,
)
from stochvi.isolators.sizing.answer import Sizing
from stochvi.isolators.sizing.size import risk_curve
from stochvi.methods.linearisation import linearise
from stochvi.methods.monte_carlo import record_path, simulate
from stochvi.methods.periodic import harmonic_response
from stochvi.model.model import model_of
from stochvi.results.base import Response
from stochvi.results.deadline import Progress
from stochvi.results.errors import NotConverged, StochviError
from stochvi.results.estimates import Estimate
from stochvi.scenes.datasets import profiles
from stochvi.scenes.scene import Scene
from stochvi.views.tables import of_less_risk, of_three_sigma, of_your_stops

FEW_PATHS, PATHS = 64, 512
"""Paths of the first simulation of a turn, and of its refinement."""

BUDGET = 20.0
"""Largest time of a part of a turn, s."""

CONFIRMED, CONFIRM_SECONDS = 0.01, 120.0
"""Relative error of a rate that is confirmed, and the largest time that it may take, s."""

PAGE_SECONDS = 1800.0
"""Largest time that the turns of a file may take, s."""

PATIENCE = 0.05
"""Time after which what waits looks whether it is still wanted, s."""

NEAR, FAR, PLACES = 0.8, 7.0, 60
"""Clearances of Rice's curve: their ends in standard deviations, and their number."""

DOTS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
"""Clearances that are simulated, and solved by the closure, in standard deviations."""

FACTORS = tuple(np.geomspace(0.1, 10.0, 9).tolist())
"""Stiffness of the stops over that of the design, for the picture of peaks."""

LINEAR = "linear motion without stops"

PERIODS, SAMPLES = 40, 40
"""Periods of the motion that moves on the page, and samples in each."""

BESIDE = ("linear", "spectra", "stiffness")
"""Parts that wait for no other turn, nor another turn for them: closed forms that need no kernel,
and what compiles many where it is first asked for."""

NEXT = {
    "linear": "the linear motion", "rate": "simulating impacts", "risk": "counting crossings",
    "motion": "the moving picture", "closure": "the closure", "spectra": "the spectra",
    "finer_rate": "simulating impacts with more paths", "dot": "simulating other clearances",
    "stiffness": "other stops; their kernels compile for up to a minute at first",
    "branches": "periodic motions", "absorbed": "simulating the absorber",
}  # fmt: skip
"""What a turn does, by its part."""

MOST_TABS, LONGEST_TAB = 64, 40
"""Largest number of turns and confirmations that are remembered, and letters of a tab."""

WARM_UP = "warm-up".ljust(LONGEST_TAB + 1)
"""The tab of the turn that compiles, which no page can name."""

MOST_MESSAGES = 2**31
"""Largest number that a message may have."""

Message = dict[str, Any]


class Stale(Exception):
    """A later turn of the same tab has come, and nobody waits for this one."""


class Refused(Exception):
    """What a message asks, or a scene does not allow, in a sentence for the page."""

    def __init__(self, sentence: str, id: Any = None) -> None:
        super().__init__(sentence)
        self.id = id


# ------------------------------------------------------------------------------
# Numbers for the page.
# ------------------------------------------------------------------------------


def stated(name: str, value: float, unit: str, method: str) -> Message:
    """A number that is known exactly, for the page."""
    return {"name": name, "unit": unit, "value": value, "method": method}


def of(name: str, estimate: Estimate | None, unit: str) -> Message | None:
    """An estimate with its 95 % interval, bias included, for the page; without one where the bias
    is not known."""
    if estimate is None or math.isnan(estimate.value):
        return None
    number = stated(name, estimate.value, unit, estimate.how)
    if estimate.bias is None and estimate.upper_95 is None:
        return number | {"method": f"{estimate.how}; no interval"}
    low, high = estimate.interval()
    return number | {"low": max(low, 0.0), "high": high}


def finite(column: Any) -> list[Any]:
    """Numbers as JSON holds them; texts as they are."""
    return [
        each if isinstance(each, str) else float(each) if math.isfinite(each) else None
        for each in column
    ]


def columns(frame: Any, names: Any = None) -> dict[str, list[Any]]:
    """Columns of a table, by default all of them."""
    return {str(name): finite(frame[name]) for name in (names or list(frame))}


# ------------------------------------------------------------------------------
# A turn: its parts, and their stages, by the kind of the scene.
# ------------------------------------------------------------------------------


@dataclass(eq=False)
class Turn:
    """A design, and the parts of the answer to it. `stale` is set by a later turn. `dots` are known
    from turns that share them. `short` says why the part at work is less exact than was asked."""

    design: Design
    seed: int
    id: int
    stale: threading.Event = field(default_factory=threading.Event)
    dots: dict[str, Message] = field(default_factory=dict)
    short: str | None = None

    @property
    def scene(self) -> Scene:
        """The scene of the design."""
        return self.design.scene

    def parts(self) -> Iterator[tuple[str, Callable[[], Message]]]:
        """The parts of the answer by their stages, in the order in which they are computed."""
        kind = kind_of(self.scene)
        if kind == "sine":
            yield "simulated", self.branches
        elif kind == "absorber":
            yield "simulated", self.absorbed
        else:
            yield "closed", self.linear
            yield from self._boxed() if kind == "box" else self._paired()

    def _paired(self) -> Iterator[tuple[str, Callable[[], Message]]]:
        alone = len(model_of(self.scene).stiffness) == 1
        if alone:
            yield "closed", self.spectra
        yield from (("simulated", self.rate), ("simulated", self.risk), ("simulated", self.motion))
        yield from (("closed", self.closure), ("refined", self.finer_rate))
        for share in DOTS:
            yield "refined", self.dot(share)
        pair = self.scene.expanded.impact_pairs[0]
        if alone and all(hasattr(law, "stiffness") for _, law in pair.stops()):
            yield "refined", self.stiffness

    def _boxed(self) -> Iterator[tuple[str, Callable[[], Message]]]:
        yield from (("simulated", self.rate), ("simulated", self.risk))

    def answer(self, stage: str, part: Callable[[], Message]) -> Message:
        """The message of a part of the answer, or why it is missing."""
        try:
            found = part()
        except (StochviError, ValueError) as reason:
            found = {"part": part.__name__, "missing": str(reason)}
        if self.short is not None:
            found["short"], self.short = self.short, None
        return {"type": "answer", "id": self.id, "stage": stage, **found}

    def so_far(self, calculate: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        """The answer of a calculation. One that falls short is shown as far as it got, with why."""
        try:
            return calculate(*arguments, **named)
        except NotConverged as reason:
            if reason.partial is None:
                raise
            # what comes after it says how to ask for more, which the page cannot
            self.short = f"Shown as far as it got: {str(reason).partition(';')[0]}."
            return reason.partial

    @cached_property
    def screened(self) -> Screening:
        """The linear motion, which several parts ask for."""
        return screen(self.scene)

    @property
    def gap(self) -> GapScreening:
        """The linear motion of the first pair."""
        return self.screened.impact_pairs[self.pair]

    def look(self, *_: Any) -> None:
        """As the progress of a calculation it ends one for which nobody waits."""
        if self.stale.is_set():
            raise Stale

    @property
    def rest(self) -> float:
        """Mean gap under the constant loads, from which clearances count, m."""
        return float(model_of(self.scene).mean_gaps[0])

    def linear(self) -> Message:
        """The linear motion of each gap, and Rice's rate of crossings over clearance."""
        pairs = self.screened.impact_pairs
        numbers = []
        for name, gap in pairs.items():
            words = f" of {name}" if len(pairs) > 1 else ""
            numbers += [
                stated(f"rms displacement{words}", gap.displacement_std, "m", LINEAR),
                stated(f"usual rule: three sigma{words}", gap.three_sigma, "m", LINEAR),
                stated(f"usual rule: impact rate by Rice{words}", gap.rice_rate, "1/s", LINEAR),
            ]
        gap = self.gap
        sigma = gap.displacement_std
        places = np.linspace(NEAR * sigma, FAR * sigma, PLACES)
        rates = [gap.rate_at(float(each)) for each in places]
        return {
            "part": "linear",
            "numbers": numbers,
            "rest": self.rest,
            "three_sigma": gap.three_sigma,
            "clearances": places.tolist(),
            "rice": rates,
            "rice_probability": [-math.expm1(-each * self.design.mission) for each in rates],
        }  # fmt: skip

    def closure(self) -> Message:
        """The impact rate by the moment closure, with its bound."""
        found = linearise(self.scene, budget=BUDGET).impact_pairs[self.pair].collision_rate
        return {"part": "closure", "numbers": [of("impact rate by the closure", found, "1/s")]}

    def spectra(self) -> Message:
        """What shakes the base over frequency, and what the mount passes on without stops."""
        found = environment(self.scene).spectra
        if found is None:
            raise ValueError("spectra are shown where noise moves the base of one mass alone")
        thin = found[::2]
        return {
            "part": "spectra", "method": LINEAR, **columns(thin, ("frequency_hz", "base_density")),
            "passed_density": finite(thin["transmissibility"] ** 2 * thin["base_density"]),
        }  # fmt: skip

    def stiffness(self) -> Message:
        """The largest acceleration of the mission, exceeded with the accepted probability, over the
        stiffness of the stops."""
        found = self.so_far(
            bumper_map, self.scene, mission=self.design.mission, exceedance=self.design.probability,
            clearances=[min(self.gap.stops.values())], stiffness_factors=FACTORS, seed=self.seed,
            budget=BUDGET, progress=self.look,
        )  # fmt: skip
        rows = found.to_frame()
        error, bias = (rows[f"peak_acceleration_{each}"] for each in ("standard_error", "bias"))
        peaks = [
            of("", Estimate(value=value, standard_error=spread, bias=off), "m/s2")
            for value, spread, off in zip(rows["peak_acceleration"], error, bias, strict=True)
        ]
        return {"part": "stiffness", "stiffness": finite(rows["stiffness"]), "peaks": peaks}

    def rate(self) -> Message:
        """Impacts on the stops, simulated with few paths."""
        return {"part": "rate", **self._simulated(FEW_PATHS)}

    def finer_rate(self) -> Message:
        """The same with more paths."""
        return {"part": "rate", **self._simulated(PATHS)}

    def _simulated(self, paths: int) -> Message:
        found = self.so_far(
            simulate, self.scene, paths=paths, seed=self.seed, budget=BUDGET, progress=self.look
        )
        return {"numbers": impacts_of(found), "paths": paths}

    def risk(self) -> Message:
        """The probability of any impact over clearance, and the clearance that keeps the target."""
        design = self.design
        found = self.so_far(
            risk_curve, self.scene, probability=design.probability, mission=design.mission,
            tolerances=design.tolerances, seed=self.seed, budget=BUDGET, progress=self.look,
        )  # fmt: skip
        numbers, doubted = [], bool(found.doubtful)
        for name, each in found.clearances.items():
            words = f" of {name}" if found.several else ""
            numbers.append(
                {"name": f"required clearance{words}", "unit": "m", "value": each.value,
                 "low": each.lower, "high": each.upper, "method": found.method}
            )  # fmt: skip
        if found.varies:
            numbers += [
                stated(f"within tolerances{f' of {name}' if found.several else ''}", value, "m",
                       "the same risk within all tolerances")
                for name, value in found.needed.items()
            ]  # fmt: skip
        lines = [*of_your_stops(found), of_three_sigma(found), *of_less_risk(found)]
        answer: Message = {
            "part": "risk",
            "numbers": numbers,
            "sentence": found.verdict(),
            "lines": [f"For Gaussian noise. {each}" for each in lines] if doubted else lines,
            "doubted": doubted,
        }
        answer["shared" if found.several else "curve"] = columns(found.curve)
        return answer if found.box is None else answer | {"box": self._box(found)}

    def _box(self, found: Sizing) -> Message:
        """Where mounts and snubbers of a box sit, m from its centre of mass; and the probability
        that each snubber is hit."""
        assert found.box is not None
        chances = dict(
            zip(found.box.pairs["pair"], found.box.pairs["chance_as_given"], strict=True)
        )
        document = self.scene.document()
        return {
            "mounts": [each["at"] for each in document["structure"]["mount"]],
            "corners": [
                {"name": pair["name"], "at": pair.get("at"), "direction": pair.get("direction"),
                 "probability": float(chances[pair["name"]])}
                for pair in document["impact_pair"]
            ],
        }  # fmt: skip

    def motion(self) -> Message:
        """A piece of one simulated path, for the moving picture."""
        model = model_of(self.scene)
        alone = len(model.stiffness) == 1
        omega = self.gap.velocity_std / self.gap.displacement_std
        period = 2.0 * math.pi / omega
        path = record_path(
            self.scene, duration=PERIODS * period, step=period / SAMPLES if alone else None,
            seed=self.seed, budget=BUDGET,
        )  # fmt: skip
        modes = path.filter(regex="^displacement").to_numpy()
        speeds = path.filter(regex="^impact_speed").to_numpy()[:, 0]
        # as many samples as the picture shows, each with the impacts since the one before
        every = max(len(path) // (PERIODS * SAMPLES), 1)
        starts = np.arange(0, len(path) - every + 1, every)
        return {"part": "motion", "path": {
            "time": finite(path["time"].to_numpy()[starts + every - 1]),
            "displacement": finite((modes @ model.pairs[0].direction)[starts + every - 1]),
            "impact_speed": finite(np.add.reduceat(speeds, starts)),
        }}  # fmt: skip

    def dot(self, share: float) -> Callable[[], Message]:
        """What gives the impact rate by the closure and by simulation at a clearance."""

        def dot() -> Message:
            clearance = share * self.gap.displacement_std
            there = at_clearances(self.scene, clearance)
            same = json.dumps(there.document())
            if same in self.dots:
                return self.dots[same]
            found: Message = {"part": "dot", "clearance": clearance}
            with contextlib.suppress(StochviError):
                closure = linearise(there, budget=BUDGET).impact_pairs[self.pair].collision_rate
                found["closure"] = of("closure", closure, "1/s")
            simulated = self.so_far(
                simulate, there, paths=FEW_PATHS, seed=self.seed, budget=BUDGET,
                progress=self.look,
            )  # fmt: skip
            rate = simulated.impact_pairs[self.pair].collision_rate
            self.dots[same] = found | {"simulated": of("simulated", rate, "1/s")}
            return self.dots[same]

        return dot

    def branches(self) -> Message:
        """The periodic motions about the frequency of a sine, stable or not."""
        asked = question_of(self.design, self.seed).arguments
        found = self.so_far(harmonic_response, self.scene, budget=BUDGET, **asked).to_frame()
        frequencies = found["frequency_hz"].to_numpy()
        near = frequencies[np.argmin(abs(frequencies - frequency_of(self.scene)))]
        stable = found[(frequencies == near) & (found["stable"] > 0) & (found["admissible"] > 0)]
        sizes = ", ".join(f"{1e3 * each:.3g} mm" for each in sorted(stable["displacement_max"]))
        sentence = f"Stable motions at {near:.4g} Hz reach {sizes or 'no place: none was found'}."
        return {"part": "branches", "table": columns(found), "sentence": sentence}

    def absorbed(self) -> Message:
        """What an absorber leaves of the motion at the level of the scene, and below and above."""
        asked = question_of(self.design, self.seed).arguments
        found = self.so_far(
            absorber, self.scene, budget=BUDGET, progress=self.look, **asked
        ).to_frame()
        # the level of the scene, or that which is nearest if time ended before it
        own = found.iloc[int(np.argmin(abs(found["level_db"].to_numpy())))]
        number = {"name": "rms with the absorber over that without", "unit": "",
                  "value": float(own["rms_ratio"]), "low": float(own["rms_ratio_low"]),
                  "high": float(own["rms_ratio_high"]), "method": "simulated"}  # fmt: skip
        level = f" at {own['level_db']:+g} dB" if own["level_db"] else ""
        sentence = f"The absorber leaves {100 * own['rms_ratio']:.2g} % of the rms motion{level}."
        return {"part": "absorbed", "table": columns(found), "numbers": [number],
                "sentence": sentence}  # fmt: skip

    def confirmed(self, progress: Progress) -> Message:
        """The impacts at the design, simulated until they are well known."""
        found = self.so_far(
            simulate, self.scene, rel_error=CONFIRMED, seed=self.seed, budget=CONFIRM_SECONDS,
            threads=1, progress=progress,
        )  # fmt: skip
        return {"part": "confirmed", "clearance": min(self.gap.stops.values()),
                "numbers": impacts_of(found), "short": self.short}  # fmt: skip

    @property
    def pair(self) -> str:
        """The name of its first pair."""
        return self.scene.expanded.impact_pairs[0].name


def impacts_of(found: Response) -> list[Message]:
    """Rate and mean speed of the impacts of each pair."""
    numbers = []
    for name, pair in found.impact_pairs.items():
        words = f" of {name}" if len(found.impact_pairs) > 1 else ""
        numbers += [
            of(f"simulated impact rate{words}", pair.collision_rate, "1/s"),
            of(f"mean impact speed{words}", pair.impact_speed_mean, "m/s"),
        ]
    return [each for each in numbers if each]


# ------------------------------------------------------------------------------
# The explorer: who asks, and what is answered.
# ------------------------------------------------------------------------------


def told(answers: Iterator[Message]) -> Iterator[Message]:
    """Answers, and a sentence in the place of what a scene does not allow, or of a fault."""
    try:
        yield from answers
    except Refused as reason:
        yield {"type": "refused", "id": reason.id, "sentence": str(reason)}
    except Exception as reason:  # a fault of ours: the page goes on, and can say so
        kind = type(reason).__name__
        yield {"type": "refused", "sentence": f"this is a fault of stochvi ({kind}); report it"}


class Explorer:
    """A scene, and the turns of those who explore it.

    Raises `ValueError` for a scene that the page does not show.

    Parameters
    ----------
    command
        Words of the command line that asks the question of a design, given the name of the command,
        a file and the arguments; None where there is no command line.
    """

    def __init__(self, scene: Scene, seed: int = 0, command: CommandLine | None = None) -> None:
        self._check(scene)
        self.scene, self.seed, self.command = scene, seed, command
        self.latest: dict[tuple[str, str], Turn] = {}
        self.work = threading.Lock()  # kernels use all cores already

    def _check(self, scene: Scene) -> None:
        if scene.phases:
            raise ValueError("explore shows scenes without phases; leave [[phase]] out")
        if not scene.expanded.impact_pairs:
            raise ValueError("explore shows scenes with stops: give the scene an [[impact_pair]]")

    def warm_up(self) -> None:
        """Compile what a turn needs, until the first one asks for it."""
        for _ in self._worked(self._started("turn", Setting({}), 0, WARM_UP)):
            pass

    def answers(self, message: Any) -> Iterator[Message]:
        """The messages that answer one of the page; `ValueError` for one of no known shape."""
        known: dict[str, Callable[..., Iterator[Message]]] = {
            "open": self._open, "turn": self._turn, "confirm": self._confirm,
            "cancel": self._cancel, "take": self._take, "price": self._price, "page": self._page,
        }  # fmt: skip
        asked = message.get("type") if isinstance(message, dict) else None
        if not isinstance(asked, str) or asked not in known:
            raise ValueError(f"type must be one of {', '.join(known)}")
        number, tab = message.get("id", 0), message.get("tab", "")
        if type(number) is not int or not 0 <= number < MOST_MESSAGES:
            raise ValueError(f"id must be a whole number from 0 to {MOST_MESSAGES}")
        if not isinstance(tab, str) or len(tab) > LONGEST_TAB:
            raise ValueError(f"tab must be a text of at most {LONGEST_TAB} letters")
        setting = Setting.of(message)
        return self._told(known[asked](setting, number, tab, message.get("what")), number)

    def _told(self, answers: Iterator[Message], number: int) -> Iterator[Message]:
        """Answers, and a sentence in the place of what the scene does not allow."""
        try:
            yield from answers
        except (StochviError, ValueError) as reason:
            raise Refused(str(reason), number) from reason

    def _open(self, setting: Setting, *_: Any) -> Iterator[Message]:
        """The knobs, and what else the page begins with."""
        scene = chosen(self.scene, setting)
        laws, profile = laws_of(chosen(self.scene, Setting({}, setting.preset))), profile_of(scene)
        known = [each._asdict() for each in (*knobs_of(scene), *questions_of(scene))]
        allowed = [each for each in known if each["group"] == "tolerances"]
        yield {
            "type": "knobs", "title": scene.title, "kind": kind_of(scene),
            "knobs": [each for each in known if each not in allowed], "tolerances": allowed,
            "profile": profile, "takes_table": takes_table(scene),
            "profiles": [*profiles()] if takes_table(scene) else [],
            "law": setting.law or next(iter(laws), None), "laws": laws,
            "preset": setting.preset, "presets": [*PRESETS],
            # a kernel of a notebook has no command line, and sends no file as large as a page
            "offers": [*offers_of(scene, self.command), *(["html"] if self.command else [])],
        }  # fmt: skip

    def _started(self, kind: str, setting: Setting, number: int, tab: str) -> Turn:
        """A turn or a confirmation, which ends that before it of the same tab."""
        turn = Turn(design_of(self.scene, setting), self.seed, number)
        before = self.latest.get((tab, kind))
        if before is not None and before.id > number:  # requests may overtake each other
            turn.stale.set()
            return turn
        self._end(kind, tab)
        self.latest[tab, kind] = turn
        while len(self.latest) > MOST_TABS:
            self.latest.pop(next(iter(self.latest))).stale.set()
        return turn

    def _end(self, kind: str, tab: str) -> None:
        if (before := self.latest.pop((tab, kind), None)) is not None:
            before.stale.set()

    def _turn(self, setting: Setting, number: int, tab: str, _: Any) -> Iterator[Message]:
        self._end("turn", WARM_UP)
        yield from self._worked(self._started("turn", setting, number, tab))

    def _confirm(self, setting: Setting, number: int, tab: str, _: Any) -> Iterator[Message]:
        """What is simulated beside all turns, with its progress."""
        turn = self._started("confirm", setting, number, tab)

        def work(progress: Progress) -> Message:
            return {"type": "answer", "id": number, **turn.confirmed(progress)}

        yield from self._beside(turn, work)

    def _beside(self, turn: Turn, work: Callable[[Progress], Message]) -> Iterator[Message]:
        """The progress of long work in a thread of its own, and its message; a cancel ends it."""
        told: queue.SimpleQueue[Message | Exception | None] = queue.SimpleQueue()

        def progress(done: float, words: str) -> None:
            turn.look()
            told.put({"type": "progress", "id": turn.id, "done": done, "words": words})

        def worked() -> None:
            try:
                told.put(work(progress))
            except Stale:
                pass
            except Exception as reason:
                told.put(reason)
            told.put(None)

        threading.Thread(target=worked, daemon=True).start()
        try:
            while (found := told.get()) is not None:
                if isinstance(found, Exception):
                    raise found
                yield found
        finally:  # nobody listens any more
            turn.stale.set()
        yield {"type": "done", "id": turn.id}

    def _cancel(self, _: Setting, number: int, tab: str, __: Any) -> Iterator[Message]:
        for kind in ("confirm", "page"):
            self._end(kind, tab)
        yield {"type": "done", "id": number}

    def _grid(self, setting: Setting, asked: Any) -> Grid:
        """The designs of a file that a page asks for."""
        scene = chosen(self.scene, setting)
        knobs = {each.key: each for each in (*knobs_of(scene), *questions_of(scene))}
        return Grid.of(setting, knobs, asked)

    def _stored(self, turn: Turn, setting: Setting, dots: dict[str, Message]) -> str:
        """The messages of one design of a file."""
        own = Turn(design_of(self.scene, setting), self.seed, 0, turn.stale, dots)
        found = [each | {"next": ""} for each in self._worked(own)]
        turn.look()
        return f"[{', '.join(map(stored, found))}]"

    def _price(self, setting: Setting, number: int, tab: str, what: Any) -> Iterator[Message]:
        """What a file costs at most, by its first design, its last, and one between."""
        turn, grid = self._started("price", setting, number, tab), self._grid(setting, what)
        (opened,) = self._open(setting)

        def work(_: Progress) -> Message:
            settings, began = grid.settings(), time.monotonic()
            # designs share the rates at other clearances; these three do not
            sample = [self._stored(turn, settings[k], {}) for k in (0, grid.size // 2, -1)]
            share = grid.size / len(sample)
            seconds = share * (time.monotonic() - began)
            if seconds > PAGE_SECONDS:
                raise ValueError(
                    f"{grid.size} designs take {seconds / 60.0:.0f} min, over "
                    f"{PAGE_SECONDS / 60.0:.0f}; choose fewer knobs, or fewer values of each"
                )
            empty, some = (len(page_of(opened, grid, turns)) for turns in ([], sample))
            return {"type": "priced", "id": number, "designs": grid.size, "seconds": seconds,
                    "bytes": empty + share * (some - empty)}  # fmt: skip

        yield from self._beside(turn, work)

    def _page(self, setting: Setting, number: int, tab: str, what: Any) -> Iterator[Message]:
        """The page as a file, with stored turns."""
        turn, grid = self._started("page", setting, number, tab), self._grid(setting, what)
        (opened,) = self._open(setting)

        def work(progress: Progress) -> Message:
            turns, dots = list[str](), dict[str, Message]()
            end = time.monotonic() + PAGE_SECONDS
            for each in grid.settings():
                progress(len(turns) / grid.size, f"{len(turns)} of {grid.size} designs")
                if time.monotonic() > end:
                    raise ValueError(f"{PAGE_SECONDS / 60.0:.0f} min went by before all designs "
                                     "were known; choose fewer")  # fmt: skip
                turns.append(self._stored(turn, each, dots))
            return {"type": "file", "id": number, "name": "explore.html", "media": "text/html",
                    "text": page_of(opened, grid, turns)}  # fmt: skip

        yield from self._beside(turn, work)

    def _take(self, setting: Setting, number: int, _: str, what: Any) -> Iterator[Message]:
        """A file that is taken away."""
        design = design_of(self.scene, setting)
        with self.work:
            name, media, text = taken(str(what), design, self.seed, self.command)
        yield {"type": "file", "id": number, "name": name, "media": media, "text": text}

    def _worked(self, turn: Turn) -> Iterator[Message]:
        """The messages of a turn, one turn at work at a time, but for the parts `BESIDE`."""
        parts = [*turn.parts()]
        for (stage, part), after in zip_longest(parts, parts[1:]):
            beside = part.__name__ in BESIDE
            if not (beside or self._waited(turn)):
                return
            try:
                turn.look()
                found = turn.answer(stage, part)
            except Stale:
                return
            finally:
                if not beside:
                    self.work.release()
            yield found | {"next": NEXT.get(after[1].__name__, "") if after else ""}
        yield {"type": "done", "id": turn.id}

    def _waited(self, turn: Turn) -> bool:
        """Whether the kernels are free for a turn before it is stale."""
        while not self.work.acquire(timeout=PATIENCE):
            if turn.stale.is_set():  # else those who turn fast leave a queue behind them
                return False
        return True
