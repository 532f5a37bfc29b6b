"""Shocks in a measured record: found above the level of its noise, cut out, counted and judged.
Chapters: the level of the noise, and the threshold; shocks in the record; the answer; the
calculation.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Vector, root_between
from stochvi.mathematics.spectra import welch
from stochvi.mathematics.units import ACCELERATION, FORCE, HOURLY, ShownQuantity, outside_of_share
from stochvi.results.base import DataFrame, Result, frame_of, stated, with_unit
from stochvi.results.errors import SceneError
from stochvi.results.estimates import (
    Cost,
    Estimate,
    count_of,
    poisson_interval,
    provenance,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import calculation
from stochvi.scenes.excitations import RecordedNoise
from stochvi.scenes.records import Record

Samples = NDArray[np.bool_]

# ------------------------------------------------------------------------------
# The level of the noise, and the threshold that it seldom passes.
#
# The record is looked at as it is, which shows short shocks, and smoothed, which shows long ones:
# as well damped mounts of lower and lower frequencies would feel them. Each view y has a local
# level s, the larger of the rms values before and after a moment (V. G. Hansen 1973 judges radar
# echoes so): noise that becomes louder is no shock. A view of Gaussian noise goes beyond u s, on
# either side, at a share 4 E T(u s / sigma, a) of its samples, with T of D. B. Owen (1956),
# a^2 = (1 - r) / (1 + r) and r the correlation of neighbouring samples. The mean is over s: a mean
# square of n independent values follows chi-square of n degrees.
# ------------------------------------------------------------------------------


SLOWEST = 0.5
"""Frequency below which a record is taken to drift, Hz; it is lower for a slower mount."""

LOWEST = 8.0
"""Lowest frequency to which the record is smoothed, over that below which it drifts."""

LEVEL_DEGREES, FEWEST_DEGREES = 100.0, 20.0
"""Number of independent values on which a local level rests, and the smallest one."""

LONGEST_WINDOW = 0.2
"""Longest window of a local level over the length of the record."""

FULL_WINDOW = 0.25
"""Share of a window that must hold noise alone for a level."""

START = 6.0
"""Largest value of noise, over the local median of its size, from which the search begins: four
standard deviations."""

GAUSSIAN_MEDIAN = 0.6745
"""Median of the absolute value of a normal number of standard deviation 1."""

SCORES = np.linspace(-8.0, 8.0, 321)
"""Normal scores over which the level is averaged."""

AT_REST = 1e-8
"""Mean square of the quiet samples over that of the record below which it is at rest."""

HIGHEST_THRESHOLD = 100.0
"""End of the search for a threshold, in local levels."""

SEGMENTS = 16
"""Number of segments of the density from which the memory of the noise is read."""


class View(NamedTuple):
    """Values of the record as it is, or smoothed, with the local level of the noise in them, and
    the threshold in such levels. `degrees` is the number of independent values in a window of it,
    and `correlation` that of neighbouring samples of the noise."""

    values: Vector
    level: Vector
    threshold: float
    degrees: float
    correlation: float

    @property
    def over_level(self) -> Vector:
        """Distances from the mean, in local levels."""
        return np.abs(self.values) / self.level


def _medians(values: Vector, size: int, parts: int = 1) -> Vector:
    """Medians of blocks of so many samples, joined by straight lines; or running medians over so
    many `parts` of a block, which keep a step as it is."""
    blocks = np.array_split(values, max(len(values) * parts // size, 1))
    ends = np.cumsum([len(each) for each in blocks])
    centres = ends - 0.5 * np.array([len(each) for each in blocks]) - 0.5
    middles = np.array([np.median(each) for each in blocks])
    if parts > 1:
        middles = scipy.ndimage.median_filter(middles, parts + 1, mode="nearest")
    return np.asarray(np.interp(np.arange(len(values)), centres, middles))


def smoothed(values: Vector, fs: float, highest_hz: float) -> Vector:
    """Values without what is faster than a frequency: the gain of a mount of that natural frequency
    and the damping ratio 0.7, without its delay."""
    length = scipy.fft.next_fast_len(len(values) + int(2.0 * fs / highest_hz), True)
    gain = 1.0 / np.sqrt(1.0 + (np.fft.rfftfreq(length, 1.0 / fs) / highest_hz) ** 4)
    return np.asarray(np.fft.irfft(np.fft.rfft(values, length) * gain, length)[: len(values)])


def noise_memory(values: Vector, fs: float) -> float:
    """The integral of the squared autocorrelation over all lags, s: a mean square over a time T is
    that of T / memory independent values.

    >>> white = np.random.default_rng(1).normal(size=2**16)
    >>> round(noise_memory(white, 100.0), 3)
    0.01
    """
    frequency, density = welch(values, fs, len(values) // SEGMENTS)
    scatter = 1.0 + 1.0 / (2.0 * SEGMENTS - 1.0)  # of the squares of a density
    return float(0.5 * np.sum(density**2) / np.sum(density) ** 2 / frequency[1] / scatter)


def local_level(values: Vector, quiet: Samples, window: int) -> Vector:
    """The larger of the rms values in a window before each sample and in one after it, from `quiet`
    samples alone."""
    squares = np.concatenate([[0.0], np.cumsum(np.where(quiet, values**2, 0.0))])
    counts = np.concatenate([[0], np.cumsum(quiet)])
    here = np.arange(len(values))
    found = np.zeros(len(values))
    before, after = (np.maximum(here - window, 0), here), (here + 1, here + 1 + window)
    for first, last in (before, np.minimum(after, len(values))):
        count = counts[last] - counts[first]
        mean = (squares[last] - squares[first]) / np.maximum(count, 1)
        found = np.maximum(found, np.where(count >= FULL_WINDOW * window, mean, 0.0))
    return np.sqrt(np.where(found > 0.0, found, squares[-1] / counts[-1]))


@lru_cache(maxsize=64)
def _levels(degrees: float, windows: float) -> Vector:
    """Quantiles, at `SCORES`, of the largest rms of so many windows over the true one."""
    largest = scipy.special.ndtr(SCORES) ** (1.0 / windows)
    return np.asarray(np.sqrt(2.0 / degrees * scipy.special.gammaincinv(0.5 * degrees, largest)))


def share_beyond(threshold: float, correlation: float, degrees: float, windows: float) -> float:
    """Share of the samples at which Gaussian noise goes beyond a threshold, on either side. The
    threshold counts in levels that are the largest of so many `windows`.

    >>> known = share_beyond(4.0, 0.0, 1e9, 1.0), 2.0 * scipy.special.ndtr(-4.0)
    >>> bool(abs(known[0] / known[1] - 1.0) < 1e-3)
    True
    """
    weights = np.exp(-0.5 * SCORES**2)
    turn = math.sqrt((1.0 - correlation) / (1.0 + correlation))
    beyond = scipy.special.owens_t(threshold * _levels(degrees, windows), turn)
    return float(4.0 * np.sum(weights * beyond) / np.sum(weights))


def view_of(
    values: Vector, quiet: Samples, fs: float, shortest: float, false_alarms: float,
    other: Vector | None,
) -> View:  # fmt: skip
    """The level and the threshold of a view from its quiet samples, in windows that are not shorter
    than so many seconds. The level changes at least as much as another one."""
    noise = np.where(quiet, values, 0.0)
    if float(np.mean(noise**2)) < AT_REST * float(np.mean(values**2)):
        raise SceneError(
            "the record is at rest between its shocks, and there is no noise to judge them by; cut "
            "them out by eye, and give them to pulses"
        )
    memory, duration = noise_memory(noise, fs), len(values) / fs
    window = min(max(LEVEL_DEGREES * memory, shortest), LONGEST_WINDOW * duration)
    level = local_level(values, quiet, max(round(window * fs), 1))
    if other is not None:
        ratio = np.median(np.abs(values / other)[quiet]) / GAUSSIAN_MEDIAN
        level = np.maximum(level, ratio * other)
    scaled = np.where(quiet, values / level, 0.0)
    pairs = float(np.sum(quiet[1:] & quiet[:-1])) / float(np.sum(quiet))
    correlation = float(scaled[1:] @ scaled[:-1] / (scaled @ scaled)) / pairs
    correlation, degrees = min(correlation, 1.0 - 1e-12), window / memory
    at_ends = min(2.0 * window / duration, 1.0)

    def excess(threshold: float) -> float:
        one, two = (share_beyond(threshold, correlation, degrees, n) for n in (1.0, 2.0))
        return len(values) * (at_ends * one + (1.0 - at_ends) * two) / false_alarms - 1.0

    threshold = root_between(excess, 1.0, HIGHEST_THRESHOLD, 1e-6)
    return View(values, level, threshold, degrees, correlation)


# ------------------------------------------------------------------------------
# Shocks in the record: what goes beyond the threshold, with the swings about it, as one event. The
# quiet samples between them give the level anew, until both agree.
# ------------------------------------------------------------------------------


ROUNDS = 8
"""Largest number of times that levels and shocks are found from each other."""

SWING = 3.0
"""Local levels beyond which a swing before or after a threshold is passed belongs to the shock."""

PERIODS_APART = 3.0
"""Periods of the mount for which a shock is felt in the next one."""

PARTS = 16
"""Parts of a block of the slow mean, which follow a step."""

STEP = 0.5
"""Change of the mean over the height of an event from which it is a step, and no shock."""

WANDERS = 0.3
"""Standard deviation of the slow mean, over that of the noise, from which a record drifts."""


class Event(NamedTuple):
    """First and last sample of an event, and its largest value over the threshold."""

    first: int
    last: int
    over: float


@dataclass(eq=False)
class Search:
    """The search for shocks in a record, at a mean number of false ones. The natural frequency
    (Hz) is that of the mount, where it is known.

    `quiet` are the samples without an event. `steps` are changes of the mean, and no shocks.
    """

    record: Record
    natural_frequency: float | None
    false_alarms: float

    def __post_init__(self) -> None:
        fs, natural = self.record.fs, self.natural_frequency
        self.slowest = min(SLOWEST, (natural or math.inf) / LOWEST)
        self.block = round(fs / self.slowest)
        felt = PERIODS_APART / natural if natural else 1.0 / (LOWEST * self.slowest)
        self.apart = max(round(felt * fs), 1)
        octaves = math.floor(math.log2(max(fs / 8.0 / (LOWEST * self.slowest), 0.5))) + 1
        self.frequencies = [natural] if natural else [fs / 2.0 ** (3 + n) for n in range(octaves)]
        self.mean = _medians(self.record.values, self.block, min(PARTS, self.block))
        looked_at = self.smoothings(self.record.values - self.mean)
        sizes = np.abs(looked_at)
        medians = [_medians(each, self.block) for each in sizes]
        self.quiet = np.all(sizes < START * np.array(medians), axis=0)
        for _ in range(ROUNDS):
            before = self.quiet
            self._find(looked_at)
            if np.array_equal(before, self.quiet):
                break

    def smoothings(self, values: Vector) -> list[Vector]:
        """Values as they are, and as smoothed as the record is."""
        return [values, *(smoothed(values, self.record.fs, each) for each in self.frequencies)]

    def _find(self, looked_at: Sequence[Vector]) -> None:
        """Views, events and quiet samples anew."""
        share, level = self.false_alarms / len(looked_at), None
        self.views: list[View] = []
        for each in looked_at:
            view = view_of(each, self.quiet, self.record.fs, 1.0 / self.slowest, share, level)
            self.views.append(view)
            level = self.views[0].level
        over = np.max([each.over_level / each.threshold for each in self.views], axis=0)
        swings = np.max([each.over_level for each in self.views], axis=0) > SWING
        both = [*_joined(np.flatnonzero(swings | (over > 1.0)), over, self.apart)]
        self.steps = [each for each in both if self._is_step(each)]
        self.events = [each for each in both if each not in self.steps]
        self.quiet = ~self.inside(both)

    def _is_step(self, event: Event) -> bool:
        """Whether the mean of the record is another one after an event."""
        values, first, last = self.record.values, event.first, event.last + 1
        sides = values[max(first - self.block, 0) : first], values[last : last + self.block]
        height = np.max(np.abs(self.views[0].values[first:last]))
        before, after = (np.median(side) if len(side) else np.nan for side in sides)
        return bool(abs(after - before) > STEP * height)

    def window(self, event: Event) -> slice:
        """The samples of an event with the margins in which it is tapered."""
        margin = max(self.apart // 4, 2)
        return slice(max(event.first - margin, 0), min(event.last + 1 + margin, len(self.mean)))

    def inside(self, events: Sequence[Event]) -> Samples:
        """Whether each sample is in the window of an event."""
        found = np.zeros(len(self.mean), bool)
        for event in events:
            found[self.window(event)] = True
        return found

    @property
    def noise(self) -> float:
        """Standard deviation of the quiet samples."""
        return float(np.sqrt(np.mean(self.views[0].values[self.quiet] ** 2)))

    @property
    def band_hz(self) -> Sequence[float]:
        """The band without the drift, Hz; empty where there is none."""
        drifts = float(np.std(self.mean)) > WANDERS * self.noise
        return (self.slowest, 0.5 * self.record.fs) if drifts else ()

    def cut(self, event: Event) -> Vector:
        """The values in the window of an event, over the slow mean; they rise from 0 in its
        margins, so that the ends leave no step."""
        window = self.window(event)
        part = self.views[0].values[window].copy()
        ends = event.first - window.start, window.stop - event.last - 1
        for length, side in zip(ends, (part, part[::-1]), strict=True):
            side[:length] *= np.sin(0.5 * np.pi * np.arange(length) / max(length, 1)) ** 2
        return part


def _joined(samples: NDArray[np.int64], over: Vector, apart: int) -> Iterator[Event]:
    """Samples that are no farther apart than that, as events, where one passes the threshold."""
    for group in np.split(samples, np.flatnonzero(np.diff(samples) > apart) + 1):
        if len(group) and (largest := float(over[group].max())) > 1.0:
            yield Event(int(group[0]), int(group[-1]), largest)


NINE_OF_TEN, SAMPLES_IN_SHOCK = 0.9, 4
"""Share of shocks that are found from the smallest height on, and samples in the shortest half sine
for which that is told."""


def smallest_found(search: Search) -> Iterator[dict[str, float]]:
    """Lengths (s) of half sines, and the heights from which nine of ten are found over the record:
    a shock and the noise upon it pass the threshold of the view that shows it best."""
    longest = math.floor(math.log2(max(search.apart / SAMPLES_IN_SHOCK, 1.0)))
    for number in range(longest + 1):
        count = SAMPLES_IN_SHOCK * 2**number
        shock = np.zeros(20 * count)
        shock[:count] = np.sin(np.pi * (np.arange(count) + 0.5) / count)
        peaks = [float(np.abs(each).max()) for each in search.smoothings(shock)]
        height = min(map(_height_found, search.views, peaks))
        yield {"length": count / search.record.fs, "height": height}


def _height_found(view: View, peak: float) -> float:
    """The height from which nine of ten shocks are found in a view, in which one of unit height has
    that peak."""

    def found(height: float) -> float:
        over = height * peak / view.level - view.threshold
        return float(np.mean(scipy.special.ndtr(over))) - NINE_OF_TEN

    highest = 2.0 * view.threshold * float(view.level.max()) / peak
    return root_between(found, 0.0, highest, 1e-6 * highest)


BEYOND = 3.5
"""Levels beyond which the peaks of the noise between shocks are counted, to judge it."""

DOUBTFUL = 1e-3
"""Probability of so many peaks in Gaussian noise below which a warning tells of them."""


def peaks_beyond(search: Search) -> tuple[int, float]:
    """How often the noise between shocks goes beyond `BEYOND` levels, and how often Gaussian noise
    would; of the record as it is."""
    view = search.views[0]
    outside = (view.over_level > BEYOND) & search.quiet
    share = share_beyond(BEYOND, view.correlation, view.degrees, 2.0)
    return int(np.sum(outside[1:] & ~outside[:-1])), share * float(np.sum(search.quiet))


# ------------------------------------------------------------------------------
# The answer: the shocks, their rate, the quiet record, and a scene of both.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class FoundShock:
    """A shock in a record.

    Parameters
    ----------
    start, duration
        Seconds after the first sample at which it is cut out of the record, and for how long.
    height
        Its largest distance from the slow mean of the record, with its sign and the noise on it,
        m/s^2 (or N).
    over_threshold
        That distance over the threshold, in the view of the record that shows it best.

    See Also
    --------
    stochvi.identification.FoundShocks : All of a record.
    """

    start: float = stated("start", "s", 0.0)
    duration: float = stated("length", "s", 0.0)
    height: float = stated("height", "m/s^2", 0.0)
    over_threshold: float = stated("over the threshold", "1", 0.0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FoundShocks(Result):
    """The shocks in a measured record, how often they come, and what is left without them.

    Parameters
    ----------
    record, unit
        Name of the file of the record, and the SI unit of its values.
    duration
        Seconds of the record.
    shocks
        The shocks, in turn.
    rate
        Shocks per second.
    rate_lower, rate_upper
        Exact 95 % interval of Poisson's law for it, 1/s.
    false_alarms
        Mean number of shocks, at most, that Gaussian noise of this spectrum would show in such a
        record.
    noise
        Standard deviation of what is left, m/s^2 (or N).
    peaks, peaks_expected
        How often what is left goes beyond 3.5 times its local level, and how often Gaussian noise
        would.
    smallest
        Smallest `height` (m/s^2 or N) from which nine of ten half sines of a `length` (s) are
        found.
    natural_frequency
        That of the mount for which shocks were looked for, Hz; None for any.
    band_hz
        The band that a scene keeps of a record that drifts, Hz; empty for others.
    samples
        Times and values of the record, its slow mean, the threshold about it, and whether a shock
        is there.
    cuts
        Times and values of each shock.
    assumptions
        What the count rests on, a sentence each.

    See Also
    --------
    stochvi.shocks : The calculation.
    """

    kind = "shocks"
    not_in_document: ClassVar[tuple[str, ...]] = ("samples", "cuts")

    record: str
    unit: str
    duration: float
    shocks: Sequence[FoundShock]
    rate: Estimate
    rate_lower: float
    rate_upper: float
    false_alarms: float
    noise: float
    peaks: int
    peaks_expected: float
    smallest: DataFrame
    natural_frequency: float | None
    band_hz: Sequence[float]
    samples: DataFrame
    cuts: Sequence[DataFrame]
    assumptions: Sequence[str] = ()

    @property
    def quantity(self) -> ShownQuantity:
        """The quantity of the record as it is shown."""
        return FORCE if self.unit == "N" else ACCELERATION

    @property
    def hardest(self) -> int | None:
        """Number of the shock that stands out most, from 0; None without one."""
        over = [each.over_threshold for each in self.shocks]
        return int(np.argmax(over)) if over else None

    @property
    def quiet(self) -> DataFrame:
        """Times and values of the record where there is no shock."""
        return self.samples[~self.samples["shock"]].iloc[:, :2]

    def summary(self) -> str:
        """The number of shocks, their rate and the largest one, in a sentence."""
        where = f"in {self.duration:.4g} s of {self.record}"
        most = count_of(HOURLY(self.rate_upper))
        if not self.shocks:
            return f"No shock {where}: at most {most} an hour (95 %)"
        count = "1 shock" if len(self.shocks) == 1 else f"{len(self.shocks)} shocks"
        often = f"{count_of(HOURLY(self.rate.value))} an hour"
        largest = self.quantity.text(max(abs(each.height) for each in self.shocks), ".3g")
        least = count_of(HOURLY(self.rate_lower))
        return f"{count} {where}: {often} ({least} to {most}, 95 %), up to {largest}"

    def to_frame(self) -> DataFrame:
        """One row per shock."""
        names = {"start": "start_s", "duration": "duration_s", "over_threshold": "over_threshold"}
        names["height"] = with_unit("height", self.unit)
        return frame_of(self.shocks, [*names]).rename(columns=names)

    def scene_text(self, scene: str = "") -> str:
        """The scene file of the quiet record with the hardest shock at the rate of all.

        Parameters
        ----------
        scene
            Text of a scene file whose structure, stops and other excitations it keeps; by default
            one mass on a mount of the natural frequency, which `size` finds stops for.

        Raises
        ------
        ValueError
            If there is no shock.
        """
        if self.hardest is None:
            what = f"no shock was found in {self.record}, so that no scene needs one"
            raise ValueError(f"{what}; take the record itself as the noise")
        tables = re.split(r"(?m)^(?=\[)", scene or MOUNT.format(self.natural_frequency or 10.0))
        own = [each for each in tables if not re.match(r"\[\[excitation]](?s:.*)\"record\"", each)]
        band = f"band_hz = {[*self.band_hz]}   # without drift\n" if self.band_hz else ""
        return "".join(own).rstrip() + SCENE.format(
            self.record, band, self.hardest + 1, len(self.shocks), HOURLY(self.rate.value),
            count_of(HOURLY(self.rate_lower)), count_of(HOURLY(self.rate_upper)),
        )  # fmt: skip


MOUNT = """[structure]
kind = "isolator"
frequency_hz = {:g}   # your mount
zeta = 0.1
"""
"""The part of a scene that no record knows."""

SCENE = """

[[excitation]]
kind = "record"
file = "quiet.csv"   # {} without its shocks
gaps = "split"
{}
[[excitation]]
kind = "pulses"
file = "shock-{}.csv"   # the one of {} that stands out most
rate = "{:.4g}/h"   # {} to {} an hour (95 %)
two_sided = false
"""
"""The excitations of a scene of both."""


# ------------------------------------------------------------------------------
# The calculation.
# ------------------------------------------------------------------------------


@calculation
def shocks(
    record: str | Path, *, natural_frequency: float | None = None, false_alarms: float = 0.05,
    unit: str | None = None, fs: float | None = None, column: int | str | None = None,
    gaps: Literal["refuse", "split"] = "refuse",
) -> FoundShocks:  # fmt: skip
    """Find the shocks in a measured record, cut them out, and count them.

    A shock stands out of the noise about it: of the record as it is, or smoothed as a well damped
    mount feels it. Noise that becomes louder, a drift, and a step of the mean are no shocks. Shocks
    that follow within a quarter of a second, or within three periods of the mount, are one.

    Parameters
    ----------
    record
        File of the record, of the kinds that `RecordedNoise` reads.
    natural_frequency
        That of the mount that the shocks are for, Hz: slower and faster shocks count as it feels
        them. By default it is not known.
    false_alarms
        Mean number of false shocks, at most, in Gaussian noise of this length and spectrum.
    unit, fs, column, gaps
        How the file is read, as by `RecordedNoise`.

    Returns
    -------
    FoundShocks
        The shocks, their rate with its interval, the quiet record and the scene of both.

    Raises
    ------
    SceneError
        If the file holds no record, states no unit, or is too short for the level of its noise.

    See Also
    --------
    stochvi.RecordedNoise : The noise that is left.
    stochvi.replay : The record itself.

    Examples
    --------
    >>> import tempfile
    >>> time, random = np.arange(6000) / 200.0, np.random.default_rng(1)
    >>> road = random.normal(size=6000)
    >>> for start in (1400, 3800):
    ...     road[start : start + 11] += 9.0 * np.sin(np.pi * np.arange(11) / 10.0)
    >>> file = Path(tempfile.mkdtemp()) / "road.csv"
    >>> np.savetxt(file, np.column_stack([time, road]), delimiter=",", header="time (s),a (g)")
    >>> found = shocks(file)
    >>> [round(each.start, 1) for each in found.shocks]
    [6.9, 18.9]
    >>> print(found.summary())
    2 shocks in 30 s of road.csv: 240 an hour (29.1 to 867, 95 %), up to 9.66 g
    """
    began = time.perf_counter()
    noise = RecordedNoise(file=str(record), unit=unit, fs=fs, column=column, gaps=gaps)
    duration, rate = noise.record.duration, noise.record.fs
    if natural_frequency is not None and not 0.0 < natural_frequency <= 0.25 * rate:
        raise ValueError(
            "natural_frequency must be positive and at most a quarter of the sampling rate, "
            f"{rate:g} Hz, got {natural_frequency:g}; leave it out"
        )
    if not 0.0 < false_alarms <= 1.0:
        raise outside_of_share("false_alarms", "in (0, 1]", false_alarms)
    found = Search(noise.record, natural_frequency, false_alarms)
    least = min(each.degrees for each in found.views)
    if least < FEWEST_DEGREES:
        raise SceneError(
            f"{Path(record).name} is {duration:.3g} s long, expected at least "
            f"{duration * FEWEST_DEGREES / least:.2g} s: the level of the noise must be known "
            "before a shock is; take a longer record, or give a higher natural_frequency"
        )
    cost = Cost(wall_time=time.perf_counter() - began)
    return replace(_answer(found, noise), cost=cost, provenance=provenance({}))


def _answer(search: Search, noise: RecordedNoise) -> FoundShocks:
    """The answer of a search, in SI units."""
    record, view, count = search.record, search.views[0], len(search.events)
    unit = "N" if noise.density_unit == "N2/Hz" else "m/s^2"
    names = "time (s)", f"{'force' if unit == 'N' else 'acceleration'} ({unit})"
    lower, upper = poisson_interval(count, record.duration)
    limit = None if count else upper_limit_unseen(record.duration)
    peaks, expected = peaks_beyond(search)
    times, windows = record.times, [search.window(each) for each in search.events]
    return FoundShocks(
        record=noise.record_name, unit=unit, duration=record.duration,
        shocks=[
            FoundShock(
                start=float(times[window][0]), duration=len(times[window]) / record.fs,
                height=float(max(view.values[window], key=abs)), over_threshold=event.over,
            )
            for event, window in zip(search.events, windows, strict=True)
        ],
        rate=Estimate(
            value=count / record.duration, standard_error=math.sqrt(count) / record.duration,
            how=f"{count} in {record.duration:.4g} s", upper_95=limit,
        ),
        rate_lower=lower, rate_upper=limit or upper, false_alarms=search.false_alarms,
        noise=search.noise, peaks=peaks, peaks_expected=expected,
        smallest=frame_of(smallest_found(search)), natural_frequency=search.natural_frequency,
        band_hz=search.band_hz,
        samples=frame_of({
            names[0]: times, names[1]: record.values + record.mean,
            "mean": search.mean + record.mean, "threshold": view.threshold * view.level,
            "shock": search.inside(search.events),
        }),
        cuts=[
            frame_of({names[0]: np.arange(len(each)) / record.fs, names[1]: each})
            for each in map(search.cut, search.events)
        ],
        assumptions=ASSUMED,
        warnings=[*noise.doubts(), *_doubts(search, times, peaks, expected)],
    )  # fmt: skip


ASSUMED = (
    "the level of the noise changes slowly: where it grows fourfold within seven seconds, false "
    "shocks are four times as many",
    "shocks come at independent times (Poisson)",
    "heights include the noise on a shock",
    "the scene takes every shock for the one that stands out most",
)
"""What a rate of shocks and its scene rest on."""


def _doubts(search: Search, times: Vector, peaks: int, expected: float) -> Iterator[str]:
    """What makes the count doubtful, a sentence each."""
    for step in search.steps:
        when = times[(step.first + step.last) // 2]
        yield (
            f"the mean of the record changes at {when:.4g} s: that is a step, and no shock; see "
            "whether the sensor came loose or was shifted there"
        )
    if search.band_hz:
        share = np.ptp(search.mean) / search.noise
        yield (
            f"the mean of the record wanders by {share:.2g} standard deviations of the noise: "
            "shocks are counted from it, and the scene leaves it out (band_hz)"
        )
    if scipy.special.pdtrc(peaks - 1, expected) < DOUBTFUL:
        yield (
            f"between the shocks {peaks} peaks exceed {BEYOND:g} times the level of the noise, and "
            f"{expected:.2g} would in Gaussian noise: small shocks are left in it, or its level "
            "changes within seconds, and some of the shocks may be false"
        )
