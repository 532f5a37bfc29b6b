"""The plan of structures of any number of modes with any stops, without tabulated noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.engine.arithmetic import NO_RECORD, Log
from stochvi.engine.borrowed import lent
from stochvi.engine.calls import Characteristics, Stops, functions_of, stops_of
from stochvi.engine.compliant_contacts import MOST_SWEEPS
from stochvi.engine.parts import Affine, rate
from stochvi.engine.sub_steps import (
    CONTACT_ANGLE,
    MOMENTS,
    MOST_TERMS,
    Responses,
    responses_of,
)
from stochvi.engine.together import FASTEST, NOT_KNOWN, Known, known_contacts
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.spectra import square_root, step_covariance, transition
from stochvi.model.coverage import Settling, slowest_of, without_noise
from stochvi.model.modal import LinearLaw, ModalForm, linear_law
from stochvi.model.model import UPPER, Model, Pair, Stop, not_stationary
from stochvi.model.scales import (
    Motion,
    PairScale,
    Scales,
    default_threshold,
    form_of,
    motions_of,
    scales_of,
    speed_of_stop,
)
from stochvi.motion.kernels.modes import (
    Kicks,
    Largest,
    ModalPaths,
    ModalSteps,
    Outputs,
    Passes,
    SmoothResponse,
    Steps,
    Table,
    Until,
    make_room,
    run_modes,
)
from stochvi.motion.kernels.random_numbers import normal_rows, seed_streams
from stochvi.motion.plan import (
    RELAXATIONS,
    SUMS_OF_PAIR,
    Histories,
    Key,
    Layout,
    Plan,
    Statistic,
    Underway,
    bias_of_fast_impacts,
    bias_of_lasting_contact,
    bias_of_plain_step,
    bias_of_refined_step,
    bias_of_smooth_motion,
    bias_of_sticking,
    gap_of,
    key_of_statistic,
    losses_of,
    lossiest,
    normals_of_steps,
    refines_near_stops,
    statistics_of,
    streams_of,
)
from stochvi.motion.synthesis import MOST_SUB_STEPS
from stochvi.motion.white import (
    BOUNCE_PER_STEP,
    COARSE_SHARE,
    DURATION,
    GAP_PER_STEP,
    LONGEST_BLOCK,
    LOSSY_ANGLE,
    LOSSY_DECAY,
    MOMENT_ANGLE,
    MOST_STEPS,
    block_of,
    longest_at_stops,
    longest_between_stops,
)
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import check_flag, stop_flag
from stochvi.scenes.impact_laws import CompliantLaw, Viscoelastic

LARGEST_ANGLE = 0.4
"""Largest omega h of a step (rad) for the fastest mode or signal, if any step is free of bias: the
quintic that finds impacts and the Taylor series then have relative errors below 1e-7."""

ANGLE_OF_ONE_MODE = 0.6
"""The same of one mode with compliant stops, whose bias states these errors (`relative_bias` of its
plan)."""

LONGEST_FLOW = 2.0
"""Largest norm of the generator times the step (dimensionless) at which the series converges and
quintics find impacts: their errors are below (omega h)^6 / 46080 of an amplitude."""

FARTHEST_REST = 1e10
"""Largest distance of a rest position under loads from that without, in standard deviations: of the
motion six digits are then left beside it."""

MOST_MODAL_STEPS = MOST_STEPS / 4.0
"""Largest number of steps of one path: a step takes longer than that of one oscillator."""

CONTACT_PRICE = 4.0
"""Time of a step where a stop is compliant, in units of that where all are rigid."""

LYING = 16.0
"""Time of a step of a mass that lies on a stop, in units of the time of a step between the
stops."""

INDEPENDENT = 1e-12
"""Variance of a principal component of a kick below which it is left out, relative to the
largest."""

NEGLIGIBLE = 1e-10
"""Noise of signals is left out of a step where it adds less to the variance of a state, relative to
that variance."""

SERIES_ERROR = 1e-13
"""Relative error of the Taylor series of the response to an impact."""

MOST_CROSSED = 3
"""Largest number of modes for which the noise of each is multiplied with the motion of every other.
With more modes each is multiplied with itself alone: the products grow with their square."""

RESOLVING_SHARE = 1.0 / 16.0
"""Step that resolves slow impacts, as a share of the usual one. Rates at R = 0.1 and 0.3 were then
within 1 % of their limit, and 10 and 1 % below it at the usual step."""

MOMENTS_PER_MODE = 4.0
"""Largest number of moments per mode and step. Above it they are sampled less often: there are n^2
of them, which would take far longer than the step of many modes."""

LONGEST_SAMPLE = 1.6
"""Largest omega of a sine times the time between two samples of the moments (rad): at half a
period its square would be sampled at one phase."""

SUMS_OF_PART = ("impulse", "virial", "work")
"""Names of the sums of a spring or damper that is a function, by `kick_all` of its kernel: the
force that the linear structure leaves out, that times the displacement, and its work."""

SUMS_OF_CONTACT_PAIR = (
    *SUMS_OF_PAIR,
    *(
        f"{name}_{side}"
        for side in ("lower", "upper")
        for name in ("force", "loss", "peak", "contact", "ended")
    ),
)
"""Names of the sums over the impacts and the contacts of a pair, with either stop: impulse, work
lost, the peak forces of ended contacts, the time in contact, and the number of ended contacts, slow
ones included. Forces and powers are per unit of the reduced mass. There are ROWS_OF_CONTACT_PAIR
of them."""

CONTACT_ENERGY = 2e-6
"""Relative error of the energy of a structure by a contact with a stop that loses nothing: the mean
over contacts with linear, Hertzian and tabulated stops of all stiffnesses was 1.2e-6 at most."""

CURVE_ENERGY = 3e-4
"""The same by the quintic between the ends of a step, over (omega h)^6: of one mode on linear,
Hertzian and tabulated stops of all stiffnesses it was 1.3e-5 at most at omega h = 0.6."""

CONTACT_FRICTION = 4e-3
"""Relative bias of a motion with friction at compliant stops: paths of 12 s with 20 to 30 contacts
were off by at most 3.4e-3 of their largest displacement, against an integrator by events."""

RUBBING = "rubbing"
"""Name of the power that friction at the stops of a pair takes beyond their restitution, per unit
of the reduced mass, m^2/s^3."""

Which = tuple[int, int, int]
"""Seed, first path and number of paths that are simulated together."""

NO_OUTPUTS = Outputs()
"""The outputs of a kernel that adds up alone."""


@dataclass(frozen=True, kw_only=True)
class ModalPlan(Plan):
    """Steps, start and lengths for a scene of any structure without tabulated noise (SI units).

    Steps that are `merged` take the noise of two steps of half their length.
    """

    law: LinearLaw
    pairs: tuple[PairScale, ...]
    speed_threshold: float | Mapping[str, float] | None
    merged: bool = False
    statistics: Mapping[str, Statistic] = field(default_factory=dict)
    slow_impacts: bool = False

    coarse_share = COARSE_SHARE

    @property
    def method(self) -> str:
        """Name of the scheme, for the assumptions of a response."""
        if not self.contacts:
            return "kick-flow-kick in modal coordinates"
        way = "kick-flow-kick" if self.modes.kicked else "exact steps"
        return f"{way} in modal coordinates, contacts integrated in sub-steps"

    @property
    def excitation_known(self) -> bool:
        """Whether histories hold the excitation: white noise that alone moves one mode."""
        modes, model = self.modes, self.model
        alone = not (len(modes.signals) or modes.branches or model.functions or self.merged)
        return modes.size == 1 and modes.kicked and alone

    def excitation(self, which: Which, free: NDArray[np.float64] | None, samples: int) -> Matrix:
        """The excitation of `Histories`, per unit mass: white noise as the mean over the step after
        each sample."""
        drawn = normals_of_steps(*which, self.steps, None)[self.settling :][:samples]
        size = math.sqrt(float(self.modes.white[0, 0]) / self.model.unit_mass / self.step)
        return np.ascontiguousarray((size * drawn).T)

    # Noise: white noise and signals act in kicks and states --------------------------------------

    @property
    def counted_of_block(self) -> int:
        """Counted steps of a path in a block of its noise."""
        return self.steps

    def streams(self, seed: int, first_path: int, paths: int) -> NDArray[np.uint64]:
        """Random streams (2, paths) of kicks and states."""
        return streams_of(seed, first_path, paths)

    def free_response(
        self, seed: int, first_path: int, paths: int, number: int
    ) -> NDArray[np.float64] | None:
        """The motion without stops that is synthesised for block `number`; none."""
        return None

    @property
    def contacts(self) -> bool:
        """Whether impacts on a stop are summed one by one; pairs then have SUMS_OF_CONTACT_PAIR."""
        return self.model.summed

    @property
    def sums_of_pair(self) -> tuple[str, ...]:
        """Names of the sums over impacts and contacts of a pair."""
        return SUMS_OF_CONTACT_PAIR if self.contacts else SUMS_OF_PAIR

    @property
    def relative_bias(self) -> float:
        """Relative bias of contacts in sub-steps, curves in steps, and friction.

        Errors of the energy add up for as long as it is remembered.
        """
        if not self.contacts:
            return 0.0
        soft = any(
            stop.law.friction_coefficient and not stop.rigid
            for pair in self.model.pairs
            for stop in pair.stops
        )
        of_a_contact = CONTACT_ENERGY + CURVE_ENERGY * (self.modes.fastest * self.step) ** 6
        return of_a_contact * self.hits_in_a_cluster + (CONTACT_FRICTION if soft else 0.0)

    def _known_contacts(self, stops: Stops, responses: Responses) -> Known:
        """The contacts of one mode, in which no noise acts, by the speed of their touch."""
        model, modes = self.model, self.modes
        alone = modes.size == len(self._ways) == 1 and not (len(modes.signals) or modes.branches)
        if not (self.contacts and alone and modes.kicked) or model.tables or model.moves_stops:
            return NOT_KNOWN
        (pair,), (scale,) = model.pairs, self.pairs
        hardest = scale._replace(speed=FASTEST * scale.speed)
        rates = [rate_of_contact(pair, stop, hardest) for stop in pair.stops if not stop.rigid]
        return known_contacts(
            stops, self._stops[1], responses, scale.speed, self.step, float(modes.squares[0]),
            math.hypot(modes.fastest, *rates),
        )  # fmt: skip

    @cached_property
    def _fastest_of_contacts(self) -> float | None:
        """Fastest rate of the structure in contacts, rad/s; None where all stops are rigid."""
        if not self.contacts:
            return None
        if self.modes.kicked:
            return self.modes.fastest
        return max(self.modes.fastest, float(np.linalg.eigvalsh(self.modes.damping)[-1]))

    @property
    def modes(self) -> ModalForm:
        """The model in modal coordinates."""
        return self.model.modal

    @property
    def fastest(self) -> float:
        """Largest frequency of a mode or a signal, rad/s."""
        return self.modes.fastest

    @property
    def kicked(self) -> bool:
        """Whether there is white noise, which acts in kicks a step apart."""
        return self.modes.kicked

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy, s."""
        return self.law.slowest

    @property
    def speeds(self) -> tuple[float, ...]:
        """Rms speed of the gap of each pair, m/s."""
        return tuple(scale.speed for scale in self.pairs)

    @property
    def elastic(self) -> bool:
        """Whether the stationary distribution is exact at any step: all noise at one temperature,
        and elastic stops."""
        return self.model.elastic and self.model.temperature is not None

    @property
    def states(self) -> int:
        """Number of displacements, velocities, states of signals, and memories of springs."""
        return len(self.law.covariance) + self._memories

    @property
    def _memories(self) -> int:
        """Number of springs with a memory or white modulation, which are the last states."""
        return sum(part.law.remembers for part in self.model.functions if part.signal is None)

    @cached_property
    def _white_modulations(self) -> list[tuple[int, float]]:
        """Number among the memories, and intensity, s, of each white modulation."""
        own = [p for p in self.model.functions if p.law.remembers and p.signal is None]
        return [(k, p.white_modulation) for k, p in enumerate(own) if p.white_modulation]

    @cached_property
    def layout(self) -> Layout:
        """Meaning of the rows of `averages`."""
        rows: list[Key] = [
            (name, what) for name in self.model.outputs for what in ("x", "xx", "vv")
        ]
        rows += [("", what) for what in ("kinetic", "potential", "dissipation")]
        rows += [(gap_of(pair), what) for pair in self._relative for what in ("x", "xx", "vv")]
        thresholds = {}
        for pair, scale in zip(self.model.pairs, self.pairs, strict=True):
            rows += [(pair.name, name) for name in self.sums_of_pair]
            thresholds[pair.name] = self._threshold(pair, scale)
        rows += [(pair.name, RUBBING) for pair in self._rubbed]
        rows += [(part.name, what) for part in self.model.functions for what in SUMS_OF_PART]
        rows += [key_of_statistic(name) for name in self.statistics]
        if self._pulls is not None:
            rows += [(name, what) for name in self.model.outputs for what in ("a", "aa")]
        places = self.model.output_rows @ self._origin
        origins = dict(zip(self.model.outputs, places.tolist(), strict=True))
        for pair in self._relative:
            origins[gap_of(pair)] = float(pair.direction @ self._origin)
        controls = self._controls
        return Layout(
            rows=(*rows, *controls), origins=origins, thresholds=thresholds, controls=controls
        )

    @property
    def _controls(self) -> dict[Key, float]:
        """Keys of what `_control_rows` gives, and expected values: noise is independent of the
        motion before it."""
        crossed = self._crossed.tolist() if self.modes.kicked else []
        squares = [("", f"noise vv {k} {j}") for k, j in crossed if k <= j]
        return dict.fromkeys([*squares, *(("", f"noise xv {k} {j}") for k, j in crossed)], 0.0)

    @property
    def _crossed(self) -> NDArray[np.int64]:
        """Pairs of modes (crossings, 2) of which the noise of the second is multiplied with the
        motion of the first; of each mode with itself first."""
        n = self.modes.size
        own = [(k, k) for k in range(n)]
        others = [(k, j) for k in range(n) for j in range(n) if k != j and n <= MOST_CROSSED]
        return np.array(own + others)

    @property
    def _rubbed(self) -> list[Pair]:
        """Pairs whose stops rub. For a kernel the motions along them are further pairs, without
        stops, after all others."""
        return [pair for pair in self.model.pairs if pair.tangent is not None]

    @cached_property
    def _ways(self) -> Matrix:
        """Modal rows (pairs, modes) of all gaps, then of the motions along stops that rub."""
        along = [pair.tangent for pair in self._rubbed]
        rows = np.array(along).reshape(len(along), len(self.model.coordinates))
        return np.vstack([self.modes.gaps, rows @ self.modes.shapes])

    @cached_property
    def _masses(self) -> Vector:
        """Reduced masses, kg, of `_ways`."""
        pairs = self.model.pairs
        along = 1.0 / np.sum(self._ways[len(pairs) :] ** 2, axis=1)
        return np.concatenate([[pair.mass for pair in pairs], along])

    @property
    def _relative(self) -> list[Pair]:
        """Pairs between two coordinates, whose relative displacement is reported as well."""
        return [pair for pair in self.model.pairs if pair.relative]

    def _threshold(self, pair: Pair, scale: PairScale) -> float:
        given = self.speed_threshold
        if isinstance(given, Mapping):
            return given[pair.name]
        return default_threshold(pair, scale.speed) if given is None else given

    @property
    def _origin(self) -> Vector:
        """Expected mean positions of the coordinates, m (n,), from which moments are taken."""
        origin: Vector = self.modes.shapes @ (self.modes.rest + self.law.mean)
        return origin

    @property
    def block(self) -> int:
        """Number of paths in a block, the unit of work, which takes some seconds at most."""
        # steps on a stop are simulated path by path where no kick lifts the mass off it
        price = CONTACT_PRICE if self.contacts else 1.0
        price = price if self.modes.kicked else LYING
        return block_of(self.steps_per_path, LONGEST_BLOCK / price)

    @property
    def hits_in_a_cluster(self) -> float:
        """Number of natural periods in a relaxation time of the energy, at least 1: there is at
        most one impact on a stop in a period."""
        return max(1.0, self.modes.fastest / (2.0 * math.pi) * self.law.slowest)

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the step leaves in a quantity, from its difference to twice the step; None
        for rates of slow impacts under white noise (`step_bias`)."""
        if not self.modes.kicked and any(part.law.sticks for part in self.model.functions):
            return bias_of_sticking(difference)
        drawn = bool(self.model.drives) or bool(self._white_modulations)
        kicked = self.modes.kicked or drawn
        pressed = any(scale.pressing > 0.0 for scale in self.pairs)
        if not kicked and pressed and self.model.tables:
            return bias_of_lasting_contact(difference)
        if not kicked or not self.model.stops:
            return bias_of_smooth_motion(difference)
        if name == "peak_force" and any(isinstance(s.law, Viscoelastic) for s in self.model.stops):
            # the force of a damper follows the rate, whose peaks noise makes between kicks
            return bias_of_fast_impacts(difference, 0.0)
        if self.slow_impacts and not pressed:
            return bias_of_refined_step(name, difference, lossiest(self.model))
        return bias_of_plain_step(name, difference, lossiest(self.model), not pressed)

    def coarser(self) -> ModalPlan:
        """The same paths at twice the step and with the same noise, to measure what the step leaves
        as bias."""
        return replace(self.with_step(2.0 * self.step), merged=True)

    def resolving_slow_impacts(self) -> Self:
        """The same paths with steps that resolve slow impacts on rigid stops under white noise."""
        model = self.model
        if not refines_near_stops(model):
            what = "tabulated noise and pulses" if model.rigid else "compliant stops"
            raise NotApplicable(
                "slow_impacts", f"it must be left out with {what}, where it refines no steps"
            )
        found = replace(self.with_step(RESOLVING_SHARE * self.step), slow_impacts=True)
        check_number_of_steps(found.step, found.burn_in, found.duration)
        return found

    def finer(self) -> ModalPlan:
        """The same paths at half the step."""
        return self.with_step(self.step / 2.0)

    def with_step(self, step: float) -> Self:
        """The same paths at a chosen step, s; ValueError if it is too long to detect all
        impacts."""
        self.check_step(step)
        return replace(self, step=step)

    def check_step(self, step: float) -> None:
        """Raise ValueError for a step, s, that is too long to detect all impacts."""
        if self.model.pairs and self._size_of_flow * step > LONGEST_FLOW:
            longest = LONGEST_FLOW / self._size_of_flow
            raise ValueError(
                f"step must be at most {longest:.3g} s where there are stops, got {step:g} s"
            )

    def begin(
        self, seed: int, first_path: int, paths: int, record: Matrix | None = None,
        log: Log | None = None, accelerations: Matrix | None = None,
    ) -> ModalUnderway:  # fmt: skip
        """The paths of `averages` before their first step."""
        return ModalUnderway(self, seed, first_path, paths, record, log, accelerations)

    @cached_property
    def _rows(self) -> dict[str, slice]:
        """Rows of the sums of a kernel, by what they hold."""
        ends = np.cumsum([0, *self._heights.values()]).tolist()
        return dict(zip(self._heights, map(slice, ends, ends[1:]), strict=True))

    @property
    def _heights(self) -> dict[str, int]:
        """Number of rows by what they hold, in the order of the kernel.

        A crossing of modes has three products of noise. The last ones belong to a motion without
        stops that is synthesised.
        """
        n, of_pair = self.modes.size, len(self.sums_of_pair)
        return {
            "moments": n * (n + 2),
            "pairs": of_pair * len(self.model.pairs),
            "friction": of_pair * len(self._rubbed),
            "pulls": 0 if self._pulls is None else n * (n + 3) // 2,
            "parts": len(SUMS_OF_PART) * len(self.model.functions),
            "statistics": len(self.statistics),
            "noise": 3 * len(self._crossed) if self.kicked else 0,
            "free": 0,
            "passages": 0,
        }

    @property
    def rows_of_sums(self) -> int:
        """Number of rows of the sums of a kernel, without those from which controls are made."""
        return int(self._rows["statistics"].stop)

    @property
    def rows_with_controls(self) -> int:
        """Number of rows of the sums of a kernel."""
        return sum(self._heights.values())

    def _averaged(self, sums: Matrix, samples: int, steps: int) -> Matrix:
        """Averages over the samples of moments, per second of what pairs add up, and over the steps
        of products of noise."""
        found, rows = sums.copy(), self._rows
        found[rows["pairs"]] = self.of_pairs(sums).reshape(-1, sums.shape[1])
        counts = dict.fromkeys(("pairs", "friction", "parts", "passages"), steps * self.step)
        counts["noise"] = steps
        for what, own in rows.items():
            found[own] /= counts.get(what, samples)
        return found

    def _control_rows(self, averages: Matrix) -> Matrix:
        """The rows of `_controls` (rows, paths), from the averages of a kernel.

        They are what noise adds to second moments beyond its mean. With the kick p <- E p + f,
        f = L z, these are E p f' + f (E p)' + f f' - L L' for the velocities p, whose sum over the
        steps is a martingale, and q f' for the displacements q.
        """
        paths = averages.shape[1]
        if not self.modes.kicked:
            return np.empty((0, paths))
        n, crossed = self.modes.size, self._crossed
        first, second = crossed.T
        decay, brought = self._whole_kick
        products = np.zeros((3, n, n, paths))
        rows = averages[self._rows["noise"]].reshape(len(crossed), 3, paths)
        products[:, first, second] = rows.swapaxes(0, 1)
        places, speeds, squares = products
        speeds = np.einsum("ij,jkp->ikp", decay, speeds)
        speeds += speeds.swapaxes(0, 1) + squares - _product(brought, brought.T)[:, :, None]
        upper = first <= second
        return np.concatenate([speeds[first[upper], second[upper]], places[first, second]])

    @cached_property
    def _pulls(self) -> Matrix | None:
        """From modal displacements and velocities (before the kick) to what springs and dampers
        pull, which is minus the absolute acceleration where the base alone moves; else None."""
        if not self.model.base_alone_moves:
            return None
        decay, _ = self._half_kick
        return self.modes.pulls(self.modes.damping @ decay)

    def paths_of(self, state: Matrix, streams: NDArray[np.uint64], sums: Matrix) -> ModalPaths:
        """Paths in a state in which no contact lasts, for the kernel."""
        pairs, paths = len(self._ways), state.shape[1]
        gaps, peaks = np.full((pairs, paths), np.nan), np.zeros((paths, pairs, 2))
        return ModalPaths(state, streams, gaps, peaks, sums)

    def _advance(
        self, paths: ModalPaths, steps: Steps, outputs: Outputs = NO_OUTPUTS,
        free: NDArray[np.float64] | None = None,
    ) -> None:  # fmt: skip
        """Simulate the paths on, and add the counted steps to their sums."""
        tables = None if free is None else self.smooth(free)
        structure, fastest = self._kernel_constants, self._fastest_of_contacts
        laws = functions_of(self._stops[1], lanes=True)
        averaged = statistics_of(self.statistics, self.model, self._half_kick)
        outputs = outputs._replace(statistics=averaged)
        kicks = self._kicks
        room = make_room(paths, structure, laws, tables, kicks, outputs, fastest)
        run_modes(
            lent(paths), self._lent_constants, laws, lent(tables), lent(kicks), lent(steps),
            lent(outputs), lent(room), stop_flag(),
        )  # fmt: skip
        check_flag()

    def counts(self, state: Matrix, streams: NDArray[np.uint64], steps: int) -> NDArray[np.float64]:
        """Simulate the paths on for `steps` steps: impacts of each pair on its stops (pairs, 2,
        paths).

        `state` (states, paths) and `streams` (2, paths) are replaced by those at the end.
        """
        sums = self.fly(state, streams, steps).sums
        return self.of_pairs(sums)[
            :, [self.sums_of_pair.index("n_lower"), self.sums_of_pair.index("n_upper")]
        ]

    def fly(
        self, state: Matrix, streams: NDArray[np.uint64], steps: int,
        free: NDArray[np.float64] | None = None,
    ) -> ModalPaths:  # fmt: skip
        """Simulate the paths on for `steps` steps, which the sums of the kernel hold, with a motion
        without stops (see `follow`) if there is one.

        `state` (states, paths) and `streams` (2, paths) are replaced by those at the end.
        """
        sums = np.zeros((self.rows_of_sums, state.shape[1]))
        paths = self.paths_of(state, streams, sums)
        self._advance(paths, Steps(0, steps, steps), free=free)
        return paths

    def fly_until(
        self, state: Matrix, streams: NDArray[np.uint64], most: NDArray[np.int64], level: float, *,
        impacts: bool, forces: tuple[float, float] | None,
    ) -> Until:  # fmt: skip
        """Simulate each path on for so many steps at most, until its energy, or a stop ends it.

        Parameters
        ----------
        state, streams
            (states, paths) and (2, paths), overwritten.
        level
            Twice the energy in modal coordinates, without that of the stops.
        impacts, forces
            Whether a counted impact ends a path; and forces of the lower and the upper stop of the
            first pair, per unit of its reduced mass, that do.
        """
        count, modes = state.shape[1], self.modes
        limits = np.zeros((0, 2)) if forces is None else np.array([forces])
        end = Until(
            modes.squares, level, impacts, limits, np.asarray(most, np.int64),
            np.empty_like(state), np.empty_like(streams), np.zeros(count, np.int64),
            np.zeros(count), np.zeros(count), np.zeros(count, bool),
        )  # fmt: skip
        paths = self.paths_of(state, streams, np.zeros((self.rows_of_sums, count)))
        last = int(np.max(most))
        self._advance(paths, Steps(0, last, last), NO_OUTPUTS._replace(until=end))
        return end

    def after_first_step(self, streams: NDArray[np.uint64]) -> Matrix:
        """States of paths that start at rest, after a step that begins with half a kick.

        A step is half a kick, a flow and half a kick; the kernel begins with a whole kick, of which
        the second half of the step before is a part.
        """
        n, flow = self.modes.size, self.modes.flow
        _, brought = self._half_kick
        rows = -(-brought.shape[1] // 2)
        first, second = np.empty((2, rows, streams.shape[1]))
        normal_rows(streams[0], streams[1], first, second)
        normals = np.concatenate([first, second])[: brought.shape[1]]
        moved = transition(flow, self.step)[:, n : 2 * n] @ brought
        return np.ascontiguousarray(_product(moved, normals))

    def at_whole_periods(self, period: float) -> Self:
        """The plan with a whole number of steps in a period, s, at about the same step."""
        return self.with_step(period / math.ceil(period / self.step))

    def of_pairs(self, sums: Matrix) -> NDArray[np.float64]:
        """The sums of a kernel that belong to pairs, (pairs, sums_of_pair, paths); stops that are
        hit at once share theirs."""
        hits = sums[self._rows["pairs"]]
        found: NDArray[np.float64] = hits.reshape(
            len(self.model.pairs), len(self.sums_of_pair), sums.shape[1]
        )
        if self.model.sharing is None:
            return found
        sides = [
            [row for row, name in enumerate(self.sums_of_pair) if name.endswith(side)]
            for side in ("_lower", "_upper")
        ]
        of_stops = np.concatenate([found[:, rows] for rows in sides])
        found = found.copy()
        found[:, sides[0]], found[:, sides[1]] = np.split(
            np.tensordot(self.model.sharing, of_stops, axes=1), 2
        )
        return found

    def gaps_of(self, state: Matrix) -> Matrix:
        """Gaps (pairs, paths), m from the rest position, of states."""
        return _product(self._gaps, state[: self._gaps.shape[1]])

    def columns(self, record: NDArray[np.float64]) -> dict[str, Vector]:
        """Columns of one path: displacement and velocity of every coordinate, impact speeds."""
        n, shapes, found = self.modes.size, self.modes.shapes, {}
        for row, name in enumerate(self.model.coordinates):
            rest = float(shapes[row] @ self.modes.rest)
            found[f"displacement of {name}"] = rest + record[:, 0, :n] @ shapes[row]
            found[f"velocity of {name}"] = record[:, 0, n : 2 * n] @ shapes[row]
        for j, pair in enumerate(self.model.pairs):
            found[f"impact_speed of {pair.name}"] = record[:, 0, 2 * n + j]
        return found

    def record(self, seed: int, path: int) -> dict[str, Vector]:
        """One path from its start, by column; those of one mass do not name it."""
        record = np.zeros((self.steps, 1, self.record_width))
        self.averages(seed, path, 1, record)
        found = self.columns(record)
        if not self.model.single:
            return found
        alone = {name.partition(" of ")[0]: column for name, column in found.items()}
        return {**alone, "impact_speed": alone.get("impact_speed", np.zeros(len(record)))}

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Settled records of the paths first_path, first_path + 1, ..."""
        record = np.zeros((self.steps, paths, self.record_width))
        underway = self.begin(seed, first_path, paths, record, log)
        underway.reach(underway.total)
        n, shapes = self.modes.size, self.modes.shapes
        kept = record[self.settling : self.settling + samples]
        rest = shapes @ self.modes.rest
        return Histories(
            displacement=_mixed(shapes, kept[:, :, :n]) + rest[:, None, None],
            velocity=_mixed(shapes, kept[:, :, n : 2 * n]),
            impact_speed=np.ascontiguousarray(
                kept[:, :, 2 * n : 2 * n + len(self.model.pairs)].transpose(2, 1, 0)
            ),
            excitation=(
                self.excitation(underway.which, underway.free, samples)
                if self.excitation_known
                else None
            ),
            lost=losses_of(self.model, self.layout, underway.averages(), self.steps * self.step),
        )

    def drive(self, seed: int, path: int, samples: int, integrals: int) -> Matrix | None:
        """Forces of white noise that alone moves one mode, or of sines (coordinates, samples), N;
        those of other noise are not kept."""
        if self.kicked and self.excitation_known and not integrals:
            return self.model.unit_mass * self.excitation((seed, path, 1), None, samples)
        if self._unknown_noise:
            return None
        return self._sines(self.start(self.streams(seed, path, 1)), samples, integrals)

    @property
    def _unknown_noise(self) -> bool:
        """Whether noise acts whose values a path does not keep: white or filtered."""
        known = len(self.model.sines) == len(self.model.signals) and not self.model.drives
        return self.modes.kicked or not known

    def _sines(self, state: Matrix, samples: int, integrals: int) -> Matrix:
        """Forces of the sines (coordinates, samples), N, of a path that starts in `state`.

        The first sample is the end of the first step after the burn-in.
        """
        time = self.step * (self.burn_in_steps + 1 + np.arange(samples))
        force = np.zeros((self.modes.size, samples))
        for (first, omega, _), signal in zip(self.modes.sines, self.model.sines, strict=True):
            value, rate = state[self.modes.moving + first :][:2, 0]
            wave = (value - 1j * rate) / (1j * omega) ** integrals * np.exp(1j * omega * time)
            force += signal.direction[:, None] * wave.real
        return force

    # A motion without stops that is given, to which kicks, states and stops add -------------------

    @property
    def scale(self) -> float:
        """Frequency in rad/s by which given velocities are divided."""
        return max(self.modes.fastest, 1.0 / self.burn_in)

    def follow(
        self, free: NDArray[np.float64], log: Log | None,
        accelerations: NDArray[np.float64] | None = None,
        burn_in: int = 0, counted: int | None = None, record: NDArray[np.float64] = NO_RECORD,
        seed: int | None = None,
    ) -> NDArray[np.float64]:  # fmt: skip
        """What the stops make of paths whose motion without stops is given: the sums of all pairs,
        (pairs, sums_of_pair, paths).

        Parameters
        ----------
        free
            (samples, modes, 2 paths), modal displacements and velocities over `scale`, in turn.
            First come the samples that count, then the one from which paths begin, then those of
            the burn-in.
        log
            Gets every impact that counts, at its time since the sample before the first; None for
            none.
        accelerations
            (paths, outputs), zeros that become the largest absolute accelerations of the outputs of
            the model while a compliant stop is touched, m/s^2; None for none.
        burn_in, counted
            Number of samples that do not count, and of those that do, by default all others.
        record
            Zeros (samples that count, paths, record_width), which get the states of each.
        seed
            Seed of restitutions that scatter; None where none do.
        """
        paths = free.shape[2] // 2
        state, streams = np.zeros((self.states, paths)), np.zeros((2, paths), np.uint64)
        if seed is not None:
            seed_streams(np.uint64(seed), 0, streams)
        sums = np.zeros((self.rows_of_sums, paths))
        steps = len(free) - 1 - burn_in if counted is None else counted
        outputs = Outputs(record, log, self.largest(accelerations))
        underway = self.paths_of(state, streams, sums)
        self._advance(underway, Steps(-burn_in, steps, steps), outputs, free)
        return self.of_pairs(sums)

    def smooth(self, free: NDArray[np.float64]) -> SmoothResponse:
        """A motion without stops, for the kernel."""
        gaps, speeds = self._tables_of_gaps
        return SmoothResponse(
            samples=free, scale=self.scale, gaps=gaps, speeds=speeds, half_kick=self._to_middle
        )

    @cached_property
    def gaps_of_samples(self) -> Matrix:
        """Rows (pairs, modes and modulations) of the gaps, as a stop that moves sees them."""
        n, sampled = self.modes.size, len(self.model.sampled_modulations)
        found = np.hstack([self._ways, np.zeros((len(self._ways), sampled))])
        for row, pair in zip(found, self.model.pairs, strict=False):
            for each in pair.moved:
                if each.sample is not None:
                    row[n + each.sample] -= each.way
        return found

    @cached_property
    def _tables_of_gaps(self) -> tuple[Table, Table]:
        """Gaps and their rates, from values and slopes of the modes, then of the modulations."""
        modes, others = np.split(self.gaps_of_samples, [self.modes.size], axis=1)
        gaps = np.hstack([modes, np.zeros_like(modes), others, np.zeros_like(others)])
        speeds = np.hstack([np.zeros_like(modes), modes, np.zeros_like(others), others])
        return _table(gaps), _table(speeds)

    @cached_property
    def _to_middle(self) -> Table:
        """Velocities in the middle of the kick, from states before it."""
        n = self.modes.size
        return _table(np.hstack([np.zeros((n, n)), self._kick(self.step / 2.0)[0]]))

    def largest(self, accelerations: NDArray[np.float64] | None) -> Largest | None:
        """Largest accelerations of the outputs, for the kernel; NotApplicable where they are not
        known: under kicks, or where something other than the base moves."""
        if accelerations is None:
            return None
        if self.kicked or self._pulls is None:
            raise NotApplicable("accelerations", "need a structure that the base alone moves")
        rows = np.ascontiguousarray(self.model.output_rows @ self.modes.shapes)
        return Largest(rows=rows, table=accelerations)

    def motion_of(self, free: NDArray[np.float64] | None, sample: int) -> Matrix | float:
        """Displacements and velocities (2 modes, paths) of a sample of a motion without stops."""
        if free is None:
            return 0.0
        own = free[sample, : self.modes.size]
        return np.vstack([own[:, 0::2], self.scale * own[:, 1::2]])

    @property
    def record_width(self) -> int:
        """Number of floats recorded per sample."""
        return 2 * self.modes.size + len(self._ways)

    @property
    def _stride(self) -> int:
        n, angle = self.modes.size, max(self.modes.fastest, 1.0 / self.burn_in) * self.step
        moments = n * (n + 2) + (0 if self._pulls is None else n * (n + 3) // 2)
        sparse = moments / (MOMENTS_PER_MODE * n)
        if self.modes.sines:
            fastest = max(omega for _, omega, _ in self.modes.sines)
            sparse = min(sparse, LONGEST_SAMPLE / (fastest * self.step))
        return max(1, round(MOMENT_ANGLE / angle), round(sparse))

    def _physical(self, sums: Matrix) -> Matrix:
        """Moments of coordinates and energies from those of modes, with velocities in the middle of
        the kick."""
        if sums.shape[1] == 1:  # of a single path products are added up in another order
            return self._physical(np.repeat(sums, 2, axis=1))[:, :1]
        n, paths = self.modes.size, sums.shape[1]
        displacements, velocities = _second_moments(sums, n)
        decay, brought = self._half_kick
        velocities = np.einsum("ij,jkp,lk->ilp", decay, velocities, decay)
        velocities += _product(brought, brought.T)[:, :, None]
        shapes = self.model.output_rows @ self.modes.shapes
        rows = np.empty((len(self.layout.rows) - len(self.layout.controls), paths))
        energies = slice(3 * len(shapes), 3 * len(shapes) + 3)
        gaps = slice(energies.stop, energies.stop + 3 * len(self._relative))
        rows[: energies.start] = _mean_squares(shapes, sums[:n], displacements, velocities)
        rows[energies] = (
            np.einsum("iip->p", velocities),
            np.einsum("i,iip->p", self.modes.squares, displacements),
            np.einsum("ij,ijp->p", self.modes.damping, velocities),
        )
        relative = [pair.relative for pair in self.model.pairs]
        rows[gaps] = _mean_squares(self.modes.gaps[relative], sums[:n], displacements, velocities)
        of = {what: sums[own] for what, own in self._rows.items()}
        rubbed = of["friction"].reshape(len(self._rubbed), len(self.sums_of_pair), paths)
        rubbed = rubbed[:, 0] + rubbed[:, 3]  # at the lower and at the upper stop
        counted = np.concatenate([of["pairs"], rubbed, of["parts"], of["statistics"]])
        last = gaps.stop + len(counted)
        rows[gaps.stop : last] = counted
        if self._pulls is not None:
            squares = _symmetric(of["pulls"][n:], n)
            noise = self.modes.damping @ brought
            squares += _product(noise, noise.T)[:, :, None]
            means, squares = _product(shapes, of["pulls"][:n]), _squares(shapes, squares)
            rows[last::2], rows[last + 1 :: 2] = means, squares
        return np.concatenate([rows, self._control_rows(sums)])

    @cached_property
    def _half_kick(self) -> tuple[Matrix, Matrix]:
        """The kick from the start of a step to its middle."""
        return self._kick(self.step / 2.0)

    @cached_property
    def _whole_kick(self) -> tuple[Matrix, Matrix]:
        """The kick of a step."""
        return self._kick(self.step)

    def _kick(self, h: float) -> tuple[Matrix, Matrix]:
        """(E, L) of the kick over h: p <- E p + L z."""
        modes = self.modes
        if not modes.kicked:
            return np.eye(modes.size), np.zeros((modes.size, 0))
        brought = step_covariance(-modes.damping, modes.white, h)
        return transition(-modes.damping, h), square_root(brought, INDEPENDENT)

    def _kicked(self, flow: Matrix) -> Matrix:
        """What the kick of a step makes of all states, without its noise."""
        n, kicked = self.modes.size, np.eye(len(flow))
        kicked[n : 2 * n, n : 2 * n] = self._whole_kick[0]
        return kicked

    def _grown(self, flow: Matrix, h: float) -> Matrix:
        """What the flow makes of all states in a time h, s, by way of their own units."""
        size = self._size
        grown: Matrix = size[:, None] * transition(flow * size / size[:, None], h) / size
        return grown

    @cached_property
    def _kernel_constants(self) -> ModalSteps:
        modes, h = self.modes, self.step
        n, flow = modes.size, self.modes.flow
        motion = slice(n, 2 * n)
        _, brought = self._whole_kick
        grown, kicked = self._grown(flow, h), self._kicked(flow)
        drawn = np.hstack([grown[:, motion] @ brought, self._signal_noise(flow, h)])
        speed_drawn = np.zeros((n, drawn.shape[1]))
        speed_drawn[:, : brought.shape[1]] = brought
        normals = drawn.shape[1]
        if self.merged:
            drawn, speed_drawn = self._merged_noise(grown, flow)
            normals = drawn.shape[1] // 2
        after = self._noise_after_kicks(flow) if self.model.functions else drawn
        displacement = self._gaps
        speed = displacement @ flow
        curvature = speed @ flow
        # a grazing path may leave the hull of its cubic by its fourth derivative
        speeds = np.zeros(len(self._ways))
        speeds[: len(self.pairs)] = [scale.speed for scale in self.pairs]
        margins = (modes.fastest * h) ** 3 / 384.0 * h * speeds
        stops, _ = self._stops
        responses = self._responses(flow, speed, curvature)
        quiet = 1.0
        if self.model.functions:  # the passes start after all kicks
            kicked, quiet = np.eye(len(flow)), 0.0
        passes = Passes(
            states=_table(self._with_memories(grown @ kicked)),
            states_drawn=_table(self._with_drawn_memories(after, half=1)),
            normals=normals,
            merged=self.merged,
            speeds_kicked=_table(speed @ kicked),
            speeds_drawn=_table(quiet * (self._ways @ speed_drawn)),
            bends_kicked=_table(curvature @ kicked),
            gaps=_table(displacement),
            speeds=_table(speed),
            bends=_table(curvature),
            kicks=_table(speed_drawn if modes.kicked else speed_drawn[:0]),
            pulls=_table(np.zeros((0, modes.moving)) if self._pulls is None else self._pulls),
        )
        return ModalSteps(
            step=h,
            modes=n,
            passes=passes,
            stops=stops,
            margins=margins,
            responses=responses,
            known=self._known_contacts(stops, responses),
            origins=self.law.mean,
            crossed=self._crossed,
        )

    @cached_property
    def _lent_constants(self) -> ModalSteps:
        return lent(self._kernel_constants)

    def _with_memories(self, matrix: Matrix) -> Matrix:
        """The matrix of a pass to all states from all states. It does not change the memories of
        springs, and forgets white modulations."""
        if not self._memories:
            return matrix
        kept = np.ones(self._memories)
        kept[[number for number, _ in self._white_modulations]] = 0.0
        return np.asarray(scipy.linalg.block_diag(matrix, np.diag(kept)))

    def _with_drawn_memories(self, matrix: Matrix, half: int) -> Matrix:
        """The matrix of a pass to all states from normals, with the white modulations of the kick
        before the flow (`half` 0) or after it (1).

        Each is the mean of the white noise over half a step; their normals are the last of a step,
        or of both of its halves where two steps are merged.
        """
        found = np.vstack([matrix, np.zeros((self._memories, matrix.shape[1]))])
        white = self._white_modulations
        block = matrix.shape[1] // (2 if self.merged else 1)
        for order, (number, intensity) in enumerate(white):
            columns = np.array([2 * order + half - 2 * len(white)]) + block
            if self.merged:  # both normals of one half
                columns = np.array([2 * order, 2 * order + 1]) - 2 * len(white) + block * (1 + half)
            size = math.sqrt(2.0 * intensity / self.step / len(columns))
            found[len(matrix) + number, columns] = size
        return found

    def _noise_after_kicks(self, flow: Matrix) -> Matrix:
        """Matrix from normals to what noise adds to the states after the kicks of a step."""
        halves = [self.step / 2.0] * 2 if self.merged else [self.step]
        parts = []
        for number, h in enumerate(halves):
            _, brought = self._kick(h)
            signals = self._signal_noise(flow, h)
            if self.merged and number == 0:
                signals = self._grown(flow, h) @ signals
            parts += [np.zeros((len(flow), brought.shape[1])), signals]
        return np.hstack(parts)

    @cached_property
    def _kicks(self) -> Kicks | None:
        """Springs and dampers that are functions, for the kernel; None without any."""
        parts, modes = self.model.functions, self.modes
        if not parts:
            return None
        flow = modes.flow
        n, motion = modes.size, slice(modes.size, 2 * modes.size)
        _, brought = self._whole_kick
        speeds = np.hstack([brought, np.zeros((n, self._signal_noise(flow, self.step).shape[1]))])
        if self.merged:
            _, speeds = self._merged_noise(np.eye(len(flow)), flow)
        drawn = np.zeros((len(flow), speeds.shape[1]))
        drawn[motion] = speeds
        rows = np.array([part.direction for part in parts]) @ modes.shapes
        masses = np.array([[part.mass] for part in parts])
        free, memories = len(flow), []
        sampled = [-1 if part.sample is None else part.sample for part in parts]
        for part in parts:
            followed = None if part.signal is None else modes.moving + 2 * part.signal
            own = free if part.law.remembers else -1
            memories.append(own if followed is None else followed)
            free += followed is None and part.law.remembers
        known = Characteristics.of(
            [part.law.compiled(part.mass / part.count) for part in parts],
            [Affine(*part.affine) for part in parts],
            rows, rows * masses, rows @ modes.rest, memories,
        )  # fmt: skip
        return Kicks(
            known, np.array(sampled, np.int64), _table(self._with_memories(self._kicked(flow))),
            _table(self._with_drawn_memories(drawn, half=0)),
        )  # fmt: skip

    def _merged_noise(self, grown: Matrix, flow: Matrix) -> tuple[Matrix, Matrix]:
        """Matrices from the normal numbers of two half steps to the noise of one whole step.

        The first gives the noise of all states, the second that of the kick on modal speeds. The
        numbers of the first half step come first.
        """
        n, half = self.modes.size, self.step / 2.0
        decay, brought = self._kick(half)
        signals = self._signal_noise(flow, half)
        quiet = np.zeros((n, signals.shape[1]))
        speeds = np.hstack([decay @ brought, quiet, brought, quiet])
        states = grown[:, n : 2 * n] @ speeds
        kicks = np.zeros((len(grown), brought.shape[1]))
        states += np.hstack([kicks, self._grown(flow, half) @ signals, kicks, signals])
        return states, speeds

    def _signal_noise(self, flow: Matrix, h: float) -> Matrix:
        """Matrix from independent normals to the noise that the signals add to all states in a time
        h, s. The last columns are 0: two normals of each white modulation, for either kick."""
        modes = self.modes
        # a drive draws by the state of the streams, which normals advance
        spare = 1 if self.model.drives else 0
        modulated = np.zeros((len(flow), spare + 2 * len(self._white_modulations)))
        if not np.any(modes.signal_noise):
            return modulated
        size = self._size
        intensity = modes.noise(np.zeros_like(modes.white)) / np.outer(size, size)
        values, vectors = np.linalg.eigh(step_covariance(flow * size / size[:, None], intensity, h))
        kept = values > NEGLIGIBLE
        columns: Matrix = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return np.hstack([columns, modulated])

    @property
    def _size(self) -> Vector:
        """Standard deviation of each state; in this unit the entries of the generator are rates."""
        law = self.law
        squares = np.diag(law.covariance) + sum(np.abs(wave) ** 2 / 2.0 for wave in law.waves)
        own: Vector = np.sqrt(np.maximum(squares, 0.0))
        return np.where(own > 0.0, own, 1.0)

    @cached_property
    def places(self) -> Matrix:
        """Positions of the lower and the upper stop of each pair from the rest position, m (pairs,
        2), infinite where there is no stop."""
        places: Matrix = np.full((len(self._ways), 2), np.inf) * np.array([-1.0, 1.0])
        for j, pair in enumerate(self.model.pairs):
            rest = float(self.modes.gaps[j] @ self.modes.rest)
            for stop in pair.stops:
                places[j, int(stop.side == UPPER)] = stop.position - rest
        return places

    @cached_property
    def _stops(self) -> tuple[Stops, list[Any]]:
        """All stops for the kernel, per unit of the reduced masses, and a law of each class."""
        pairs = self.model.pairs
        laws = {
            (j, int(stop.side == UPPER)): stop.per_unit_mass(pair.mass).law.compiled()
            for j, pair in enumerate(pairs)
            for stop in pair.stops
        }
        thresholds = [
            self._threshold(pair, scale) for pair, scale in zip(pairs, self.pairs, strict=True)
        ]
        thresholds += [0.0] * len(self._rubbed)
        count, order = len(self._ways), {id(pair): k for k, pair in enumerate(self._rubbed)}
        tangents, frictions = np.full(count, -1), np.zeros((count, 2))
        for j, pair in enumerate(pairs):
            tangents[j] = len(pairs) + order[id(pair)] if id(pair) in order else -1
            for stop in pair.stops:
                frictions[j, int(stop.side == UPPER)] = stop.law.friction_coefficient
        ratios = self._masses / self._masses[tangents]
        return stops_of(
            self.places, np.array(thresholds), laws, tangents, ratios, frictions
        )  # fmt: skip

    @cached_property
    def _gaps(self) -> Matrix:
        """Rows (pairs, states) of the gaps, as a stop that moves sees them."""
        n, modes = self.modes.size, self.modes
        found = np.zeros((len(self._ways), modes.moving + len(modes.signals)))
        found[:, :n] = self._ways
        for row, pair in zip(found, self.model.pairs, strict=False):
            for each in pair.moved:
                if each.signal is not None:
                    row[modes.moving + 2 * each.signal] -= each.way
        return found

    def _responses(self, flow: Matrix, speed: Matrix, curvature: Matrix) -> Responses:
        """Taylor series of the response to a unit change of each pair's speed."""
        n, size = self.modes.size, self._size_of_flow * self.step
        masses = self._masses
        displacement, pushed = self._gaps, np.zeros((len(flow), len(masses)))
        pushed[n : 2 * n] = self._ways.T * masses
        terms = [pushed]
        while len(terms) < MOST_TERMS and (
            len(terms) < MOMENTS or _term(size, len(terms)) > SERIES_ERROR
        ):
            terms.append(flow @ terms[-1] / len(terms))
        series = np.array(terms).transpose(2, 1, 0)  # pairs, states, terms
        gaps = np.stack(
            [np.einsum("os,psk->pok", rows, series) for rows in (displacement, speed, curvature)],
            axis=2,
        )
        outputs = np.zeros((0, n))
        if self._pulls is not None:
            outputs = self.model.output_rows @ self.modes.shapes
        speeds = np.einsum("on,pnk->pok", outputs, series[:, n : 2 * n])
        accelerations = speeds * np.maximum(np.arange(len(terms)), 1)
        return responses_of(series[:, : self.modes.moving], n, gaps, accelerations)

    @cached_property
    def _size_of_flow(self) -> float:
        """Norm of the generator of displacements, velocities and branches, 1/s."""
        motion = slice(0, self.modes.moving)
        return float(np.linalg.norm(self.modes.flow[motion, motion] * self._balance, 2))

    @property
    def _balance(self) -> Matrix:
        """Factors that scale displacements by the fastest frequency, so that all entries of the
        generator are in 1/s."""
        n, omega = self.modes.size, max(self.modes.fastest, 1.0 / self.burn_in)
        size = np.concatenate([np.full(n, omega), np.ones(n)])
        if self.modes.branches is not None:  # an energy, as of the modes
            size = np.concatenate([size, 1.0 / np.sqrt(self.modes.branches.stiffness)])
        balance: Matrix = size[:, None] / size
        return balance

    @cached_property
    def _root(self) -> Matrix:
        """A square root of the covariance of the linear law."""
        return square_root(self.law.covariance, INDEPENDENT)

    def start(self, streams: NDArray[np.uint64], root: Matrix | None = None) -> Matrix:
        """Independent draws of the linear law, moved between the stops, which is close to
        stationary; `root` is another square root of its covariance."""
        modes, law = self.modes, self.law
        paths, states = streams.shape[1], len(law.covariance)
        rows = -(-states // 2) + len(modes.sines)
        first, second = np.empty((2, rows, paths))
        normal_rows(streams[0], streams[1], first, second)
        root = self._root if root is None else root
        state = _product(root, np.concatenate([first, second])[: root.shape[1]])
        for number, wave in enumerate(law.waves):
            turn = np.exp(1j * np.arctan2(first[-1 - number], second[-1 - number]))
            state += (wave[:, None] * turn).real
        if len(modes.signals) % 2:
            state[-1] = 1.0
        state[: modes.size] += law.mean[:, None]
        return self.between_stops(np.concatenate([state, np.zeros((self._memories, paths))]))

    def between_stops(self, state: Matrix, free: Matrix | None = None) -> Matrix:
        """States (states, paths) whose gaps are moved onto the stops that they lie beyond; `free`
        (pairs, paths), m, is what the gaps have besides."""
        modes = self.modes
        for _ in range(MOST_SWEEPS):
            largest = 0.0
            for j, (gap, (lower, upper)) in enumerate(zip(self._ways, self.places, strict=True)):
                row = self._gaps[j]
                (y,) = _product(row[None], state[: len(row)])
                if free is not None:
                    y = y + free[j]
                moved = np.clip(y, lower, upper) - y
                state[: modes.size] += np.outer(gap / np.sum(gap**2), moved)
                largest = max(largest, float(np.max(np.abs(moved))))
            if len(self._ways) < 2 or largest == 0.0:
                break
        return np.ascontiguousarray(state)


class ModalUnderway(Underway):
    """Paths of a `ModalPlan` under way, a block of noise after the other."""

    def __init__(
        self, plan: ModalPlan, seed: int, first_path: int, paths: int,
        record: Matrix | None = None, log: Log | None = None, accelerations: Matrix | None = None,
    ) -> None:  # fmt: skip
        self.each = plan.counted_of_block
        # where histories leave out the burn-in, it is recorded
        burn_in = plan.burn_in_steps - (0 if record is None else plan.settling)
        super().__init__(burn_in + self.each, plan.steps // self.each, burn_in)
        self.plan, self.which = plan, (seed, first_path, paths)
        self.outputs = Outputs(NO_RECORD, log, plan.largest(accelerations))
        self.record = NO_RECORD if record is None else record
        self.streams = plan.streams(*self.which)
        self.state = plan.start(self.streams)
        self.sums, self.of_block = np.zeros((2, plan.rows_with_controls, paths))

    def advance(self, segment: int, first: int, last: int) -> None:
        """Make the steps first, first + 1, ... before `last` of a block."""
        plan, before = self.plan, segment * self.each
        if first == 0:
            self.sums += self.of_block
            self.of_block[:] = 0.0
            self.free = plan.free_response(*self.which, segment)
            if self.free is not None:
                start = self.free[-1 - self.burn_in, :, 0::2]
                self.state = plan.between_stops(self.state, _product(plan.gaps_of_samples, start))
            self.paths = plan.paths_of(self.state, self.streams, self.of_block)
        log = self.outputs.log and self.outputs.log._replace(start=before * plan.step)
        outputs = self.outputs._replace(record=self.record[before : before + self.each], log=log)
        steps = Steps(first - self.burn_in, last - self.burn_in, plan._stride)
        plan._advance(self.paths, steps, outputs, self.free)

    def averages(self) -> Matrix:
        """Time averages over the counted steps so far."""
        plan, (whole, part) = self.plan, divmod(self.counted, self.each)
        samples = whole * math.ceil(self.each / plan._stride) + math.ceil(part / plan._stride)
        return plan._physical(plan._averaged(self.sums + self.of_block, samples, self.counted))


def plan_modal(
    model: Model,
    threshold: float | Mapping[str, float] | None,
    duration: float | None,
    settling: Settling = slowest_of,
) -> ModalPlan:
    """Choose step, burn-in and length for a scene of any structure without tables.

    `settling` gives the longest relaxation time with modulations, from that without.

    Raises
    ------
    NotApplicable
        Where there is no stationary state, or a mass stays on a stop that is too stiff.
    """
    if model.tables:
        raise NotApplicable(
            "simulate", "tabulated noise must be synthesised: this plan steps states alone"
        )
    plan = ModalPlan(**basis(model, threshold, duration, settling=settling))
    check_stiffness(plan)
    return plan


def rate_of_contact(pair: Pair, stop: Stop, scale: PairScale) -> float:
    """Fastest rate (rad/s) of a contact with a stop at the scale of its pair; infinite on a rigid
    one."""
    if not isinstance(stop.law, CompliantLaw):
        return math.inf
    law = stop.law.per_unit_mass(pair.mass).compiled()
    return float(rate(law, 0.0, scale.speed, scale.pressing))


def check_stiffness(plan: ModalPlan) -> None:
    """Raise NotApplicable for a stop that is too stiff to be followed while a mass stays on it.

    A mass stays where it is pressed onto the stop, or comes to rest there.
    """
    unmet = []
    for pair, scale in zip(plan.model.pairs, plan.pairs, strict=True):
        for stop in pair.stops:
            stays = scale.pressing > 0.0 or stop.law.restitution <= COLLAPSE_RESTITUTION
            if not (isinstance(stop.law, CompliantLaw) and stays):
                continue
            fastest = rate_of_contact(pair, stop, scale)
            needed = plan.step * math.hypot(fastest, plan.modes.fastest) / CONTACT_ANGLE
            if needed > MOST_SUB_STEPS:
                unmet.append(
                    f"a mass that stays on the {stop.name} stop of {pair.name}, which is this "
                    f"stiff, needs {needed:.2g} sub-steps in each step, at most {MOST_SUB_STEPS} "
                    "are made; take a rigid stop (law.kind = 'restitution')"
                )
    if unmet:
        raise NotApplicable("simulate", unmet)


def basis(
    model: Model, threshold: float | Mapping[str, float] | None, duration: float | None,
    scales: Scales = scales_of, settling: Settling = slowest_of,
) -> dict[str, Any]:  # fmt: skip
    """Arguments of every plan in modal coordinates: model, linear law, scales of pairs, step,
    lengths."""
    if conditions := without_noise(model, with_sines=True):
        raise NotApplicable("simulate", conditions)
    modes, planned = model.modal, model.with_noise_of_drives
    found = scales(planned, planned.modal)
    if found is None:
        missing = not_stationary(model) or [
            "every mode must be shaken, lose energy by damping or at stops of a restitution below "
            "1, and be held by stiffness, or by stops and loads"
        ]
        raise NotApplicable(
            "simulate", [f"{each} (no stationary state was found)" for each in missing]
        )
    law, pairs = found
    law = law._replace(slowest=_of_own_drives(model) or _of_growing_damping(model, law))
    law = law._replace(slowest=max(settling(model, law.slowest), _between_drives(model)))
    pairs = tuple(
        scale._replace(speed=math.hypot(scale.speed, speed_of_stop(model, pair)))
        for scale, pair in zip(pairs, model.pairs, strict=True)
    )
    for pair, gap, scale in zip(model.pairs, modes.gaps, pairs, strict=True):
        away = abs(float(gap @ modes.rest)) / scale.deviation
        if away > FARTHEST_REST:
            raise NotApplicable(
                "simulate",
                f"a load holds {pair.name} {away:.2g} standard deviations away from its place "
                f"without load, at most {FARTHEST_REST:.0g} are told apart",
            )
    step = _step(model, modes, law, pairs)
    burn_in = RELAXATIONS * law.slowest
    length = DURATION * burn_in if duration is None else duration
    check_number_of_steps(step, burn_in, length)
    return {
        "model": model, "law": law, "pairs": pairs, "step": step,
        "burn_in": burn_in, "duration": length, "speed_threshold": threshold,
    }  # fmt: skip


def check_number_of_steps(step: float, burn_in: float, length: float) -> None:
    """Raise NotApplicable where a path has too many steps; all in s."""
    if burn_in + length > MOST_MODAL_STEPS * step:
        why = "the times in which the scene hits, swings and settles lie too far apart"
        if (1.0 + DURATION) * burn_in <= MOST_MODAL_STEPS * step:
            why = "give a shorter duration and more paths"
        raise NotApplicable(
            "simulate",
            f"a path needs {(burn_in + length) / step:.2g} steps ({burn_in:.2g} s of burn-in and "
            f"{length:.2g} s, in steps of {step:.2g} s), at most {MOST_MODAL_STEPS:.2g} are made: "
            f"{why}",
        )


def _between_drives(model: Model) -> float:
    """Relaxation time, s, of the motion that drives leave alone: between two pulses it may be too
    small to lose energy at the stops."""
    quiet = replace(model.with_noise_of_drives, pairs=())
    law = linear_law(quiet.modal) if model.drives else None
    return 0.0 if law is None else law.slowest


def _of_own_drives(model: Model) -> float:
    """Longest relaxation time, s, where a function keeps the structure in motion: by the damping
    beside it, as the motion in noise alone does not tell. 0 for no such function."""
    driving = [part for part in model.functions if part.law.drives]
    damping = model.damping - sum(
        part.mass * part.affine[1] * np.outer(part.direction, part.direction) for part in driving
    )
    if not driving:
        return 0.0
    rates = np.linalg.eigvals(np.linalg.solve(model.mass, damping)).real
    return max((float(1.0 / rate) for rate in rates if rate > 0.0), default=0.0)


def _of_growing_damping(model: Model, law: LinearLaw) -> float:
    """The longest relaxation time, s, where dampers brake a larger motion more.

    A damper with the linear part c(s) at the rms speed s takes the power c s^2. A perturbation of
    the energy decays with its slope, c + s c' / 2, and not with c, which is small in a motion that
    excites itself.
    """
    motions, growing = motions_of(model, law), np.zeros_like(model.damping)
    for part, motion in zip(model.functions, motions, strict=True):
        less, more = (
            form_of(part, Motion(motion.mean, each * motion.deviation, each * motion.speed)).damping
            for each in (1.0 - SLOPE_SHARE, 1.0 + SLOPE_SHARE)
        )
        growing += (more - less) / (4.0 * SLOPE_SHARE) * np.outer(part.direction, part.direction)
    quiet = replace(model.with_noise_of_drives, pairs=())
    rates = quiet.rates and (
        quiet.rates[0],
        float((quiet.damping + growing)[0, 0] / quiet.mass[0, 0]),
    )
    steeper = replace(quiet, damping=quiet.damping + growing, rates=rates)
    slow, fast = linear_law(quiet.modal), linear_law(steeper.modal)
    if slow is None or fast is None or fast.slowest >= slow.slowest:
        return law.slowest
    return 1.0 / (1.0 / law.slowest + 1.0 / fast.slowest - 1.0 / slow.slowest)


SLOPE_SHARE = 1e-3
"""Share of a motion by which the slope of a damper is found."""


def _speed_of_jumps(model: Model, pair: Pair) -> float:
    """Rms change of the rate of a gap by the pulses of all drives, m/s."""
    square = 0.0
    for part in model.drives:
        assert part.drawn is not None
        jump = float(pair.direction @ np.linalg.solve(model.mass, part.direction))
        square += (jump * part.drawn.jump) ** 2
    return math.sqrt(square)


def _step(model: Model, modes: ModalForm, law: LinearLaw, pairs: tuple[PairScale, ...]) -> float:
    random = modes.kicked or bool(model.drives)
    exact = not random or (model.elastic and model.temperature is not None)
    limits = []
    if modes.fastest > 0.0:
        longest = (
            ANGLE_OF_ONE_MODE if random and model.summed and modes.size == 1 else LARGEST_ANGLE
        )
        limits.append((longest if exact else LOSSY_ANGLE) / modes.fastest)
    if not exact:
        limits.append(LOSSY_DECAY / float(law.decay[-1]))
    if not modes.kicked:
        # the damping is then part of the flow, whose fastest decay limits the step as well
        fastest = float(np.linalg.eigvalsh(modes.damping)[-1])
        limits += [LARGEST_ANGLE / fastest] if fastest > 0.0 else []
    for pair, scale in zip(model.pairs, pairs, strict=True):
        if pair.play is not None:
            speed = math.hypot(scale.speed, _speed_of_jumps(model, pair))
            limits.append(GAP_PER_STEP * scale.way(pair.play) / speed)
        if scale.pressing > 0.0:
            limits.append(BOUNCE_PER_STEP * scale.speed / scale.pressing)
    limits += [longest_between_stops(model, law, pairs), longest_at_stops(model, law, pairs)]
    return min(limits)


def _table(matrix: Matrix) -> Table:
    """A matrix by rows without its zeros: (starts of rows, columns, weights). No row is empty."""
    starts, columns, weights = [0], [], []
    for row in matrix:
        kept = np.flatnonzero(row)
        if len(kept) == 0 and len(row) > 0:
            kept = np.array([0])
        columns += kept.tolist()
        weights += row[kept].tolist()
        starts.append(len(columns))
    return np.array(starts), np.array(columns, np.int64), np.array(weights, float)


def _mean_squares(
    shapes: Matrix, means: Matrix, displacements: Matrix, velocities: Matrix
) -> Matrix:
    """Means of y, y^2 and y'^2 in turn, for combinations y = shapes . q of modal displacements."""
    rows = np.empty((3 * len(shapes), means.shape[1]))
    rows[0::3] = _product(shapes, means)
    rows[1::3] = _squares(shapes, displacements)
    rows[2::3] = _squares(shapes, velocities)
    return rows


class Aloft(NamedTuple):
    """Where some paths are that are simulated piece by piece.

    Parameters
    ----------
    state, streams
        States (states, paths), of which those of signals count at the start, and random streams.
    motion
        Displacements and velocities (2 modes, paths) of the modes.
    blocks, sample
        Number of blocks of noise that were begun, and the next sample in the last one.
    """

    state: Matrix
    streams: NDArray[np.uint64]
    motion: Matrix
    blocks: int = 0
    sample: int = 1


class Flight:
    """Paths of a plan that go on from a motion of their own, piece by piece.

    `first_path` is the number of the first one, by which each has noise of its own.
    """

    def __init__(self, plan: ModalPlan, at: Aloft, seed: int, first_path: int) -> None:
        self.plan, self.motion, self.blocks, self.sample = plan, at.motion, at.blocks, at.sample
        self.state, self.streams = at.state.copy(), at.streams.copy()
        self.which = seed, first_path, at.state.shape[1]
        if at.blocks:
            self.free = plan.free_response(*self.which, at.blocks - 1)
        else:
            self._enter_block()

    @property
    def at(self) -> Aloft:
        """Where the paths are now."""
        return Aloft(self.state, self.streams, self.motion, self.blocks, self.sample)

    def on(self, steps: int) -> Matrix:
        """Displacements and velocities of the modes (2 modes, paths) after so many more steps."""
        if self.free is not None and self.sample + steps > len(self.free):
            self._enter_block()
        first, self.sample = self.sample, self.sample + steps
        around = self.free
        if around is not None:
            around = np.concatenate([around[first : self.sample], around[first - 1 : first]])
        self.plan.fly(self.state, self.streams, steps, around)
        synthesised = self.plan.motion_of(self.free, self.sample - 1)
        self.motion = self.state[: len(self.motion)] + synthesised
        return self.motion

    def scale(self, factors: Vector) -> None:
        """Multiply the motion of each path by a factor."""
        self.state[: len(self.motion)] *= factors
        self.motion = self.motion * factors

    def _enter_block(self) -> None:
        """Pass into the next block of noise without a jump."""
        self.free, self.sample = self.plan.free_response(*self.which, self.blocks), 1
        self.blocks += 1
        self.state[: len(self.motion)] = self.motion - self.plan.motion_of(self.free, 0)


def _second_moments(sums: Matrix, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Means of q q' and of p p' (n, n, paths) from what `add_moments` of the kernel adds up."""
    half = n * (n + 1) // 2
    return _symmetric(sums[n : n + half], n), _symmetric(sums[n + half : n + 2 * half], n)


def _symmetric(rows: Matrix, n: int) -> NDArray[np.float64]:
    """Symmetric matrices (n, n, paths) from the rows of their upper triangles."""
    upper = np.triu_indices(n)
    found = np.empty((n, n, rows.shape[1]))
    found[upper] = found[upper[::-1]] = rows
    return found


def _squares(shapes: Matrix, products: NDArray[np.float64]) -> Matrix:
    """Mean squares (rows, paths) of shapes . q from the means of q q' (n, n, paths)."""
    found: Matrix = np.einsum("ij,jkp,ik->ip", shapes, products, shapes)
    return found


def _mixed(shapes: Matrix, modal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motion of the coordinates (coordinates, paths, samples) from that of the modes (samples,
    paths, modes)."""
    return np.ascontiguousarray(np.einsum("im,kpm->ipk", shapes, modal))


def _product(matrix: Matrix, columns: Matrix) -> Matrix:
    """Matrix product without the threads of a linear algebra library, which would compete with
    those that simulate paths."""
    product: Matrix = np.einsum("ij,jp->ip", matrix, columns)
    return product


def _term(size: float, order: int) -> float:
    """Bound of the term of this order in the series of the exponential of a matrix of norm
    `size`."""
    return math.exp(order * math.log(size) - math.lgamma(order + 1.0)) if size > 0.0 else 0.0
