"""Branches of periodic regimes where springs and dampers are functions."""

from __future__ import annotations

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.periodic.branches import SUBHARMONICS, Finder
from stochvi.methods.periodic.contact_branches import RANDOM_STARTS, ContactFinder, ContactMotion
from stochvi.methods.periodic.family import Family
from stochvi.methods.periodic.kernels import contact_flow, function_flow, solver
from stochvi.methods.periodic.simulations import MOST_KEPT
from stochvi.results.deadline import NEVER, Deadline

CHANGE = 1e-5
"""Change of a state, in the units of the kernels, over which the flow is differenced."""

FEW_STARTS = 4
"""As `RANDOM_STARTS`, at each of many places: altogether they are more, and all differ."""

SPEEDS = 1.0, 3.0, 10.0
"""Speeds from which simulations start: lengths of the kernels times the frequency of the force."""


class FunctionFinder(ContactFinder):
    """Finds the branches of a family whose springs and dampers are functions.

    A state holds the memories of hysteresis after displacements and velocities. Factors of small
    perturbations are differences of the flow.
    """

    random_starts = 32
    converged = 1e-9
    change = 1e-6
    kept = 0.1
    stable = 1.0 + 1e-6

    followed_at_once = 1
    """A perturbation that is differenced has to stay small."""

    @property
    def size(self) -> int:
        assert self.family.functions is not None
        return super().size + self.family.functions.remembering

    def places(self) -> list[float]:
        return self.seeds

    def flown(
        self, sigma: float, state: Vector, periods: int, phase: float = 0.0, *, factors: bool = True
    ) -> ContactMotion | None:
        system = self.system(sigma)
        motion = self._flown(system, state, periods, phase)
        if motion is None or not factors:
            return motion
        moved = [
            self._flown(system, state + way, periods, phase, measured=False)
            for way in CHANGE * np.eye(self.size)
        ]
        ends = [each.ends[-1] for each in moved if each is not None]
        if len(ends) < len(moved):
            return None
        return motion._replace(factors=(np.array(ends) - motion.ends[-1]).T / CHANGE)

    def at_point(self, u: Vector, periods: int, *, factors: bool = True) -> ContactMotion | None:
        """As for stops; factors are differences on both sides where both can be followed, those of
        Newton's iteration on one."""
        sigma, state = u[-1] / solver.WEIGHT, u[:-1]
        motion = self.flown(sigma, state, periods, factors=False)
        if motion is None or not factors:
            return motion
        system = self.system(sigma)
        grown = [self._grown(system, state, periods, 0.0, way) for way in np.eye(self.size)]
        known = [each for each in grown if each is not None]
        if len(known) < self.size:
            return self.flown(sigma, state, periods)
        return motion._replace(factors=np.array(known).T)

    def _grown(
        self, system: function_flow.System, state: Vector, periods: int, phase: float, way: Vector
    ) -> Vector | None:
        """Growth of a small perturbation in a direction, by differences."""
        low, high = (
            self._flown(system, state + change * way, periods, phase, measured=False)
            for change in (-CHANGE, CHANGE)
        )
        if low is None or high is None:
            return None
        return np.asarray((high.ends[-1] - low.ends[-1]) / (2.0 * CHANGE))

    def perturbed(
        self, sigma: float, state: Vector, periods: int, perturbation: Vector
    ) -> tuple[ContactMotion, Vector] | None:
        system = self.system(sigma)
        motion = self._flown(system, state, periods, 0.0)
        grown = self._grown(system, state, periods, 0.0, perturbation)
        return None if motion is None or grown is None else (motion, grown)

    def _flown(
        self, system: function_flow.System, state: Vector, periods: int, phase: float,
        *, measured: bool = True,
    ) -> ContactMotion | None:  # fmt: skip
        """A motion, and its output and contacts where they are `measured`."""
        kept = MOST_KEPT if measured else 0
        ends, log = np.empty((periods + 1, self.size)), np.zeros((kept, 3 + self.size))
        none = np.empty((0, 0))
        hits, *sizes = function_flow.flow(
            system, np.ascontiguousarray(state), phase, contact_flow.Record(ends, log, none)
        )
        if hits < 0 or not np.all(np.isfinite(ends)):
            return None
        log = log[: min(hits, kept)]
        return ContactMotion(ends, none, log[np.argsort(log[:, 0], kind="stable")], *sizes)

    def system(self, sigma: float) -> function_flow.System:
        """The scene at a place of the range."""
        if self._system is None or self._system[0] != sigma:
            assert self.family.functions is not None
            found = function_flow.System(
                self.motion(sigma), self.family.laws_at(sigma), self.family.functions.at(sigma)
            )
            self._system = sigma, found
        return self._system[1]

    _system: tuple[float, function_flow.System] | None = None

    def newton_starts(self, sigma: float) -> Matrix:
        # a start costs more than with linear springs: few, others at each of many places
        random = np.random.default_rng(self.seeds.index(sigma))
        count = max(FEW_STARTS, RANDOM_STARTS // len(self.seeds))
        return random.normal(size=(len(SUBHARMONICS), count, self.size))

    # Starts, with memories

    def starts(self) -> Matrix:
        """As for stops, and speeds of the first function: without stops, too, there are large
        motions beside small ones."""
        found, n = list(super().starts()), self.family.sizes[0]
        motion, functions = self.motion(0.5), self.system(0.5).functions
        row = functions.calls.rows[0] / functions.widths[0]
        for speed in SPEEDS:
            state = np.zeros(self.size)
            state[n : 2 * n] = speed * motion.omega * row
            found.append(state)
        return np.array(found)

    def at_rest(self, sigma: float) -> Vector:
        return np.append(super().at_rest(sigma), self._unloaded)

    def _random_start(self, sigma: float, random: np.random.Generator) -> Vector:
        memories = random.uniform(-1.0, 1.0, len(self._unloaded))
        return np.append(super()._random_start(sigma, random), memories)

    def _still(self, sigma: float) -> Vector | None:
        state = super()._still(sigma)
        return None if state is None else np.append(state, self._unloaded)

    @property
    def _unloaded(self) -> Vector:
        return np.zeros(self.size - super().size)


def finder_of(
    family: Family, grid: Vector, most_impacts: int, deadline: Deadline = NEVER
) -> Finder:
    """The finder of a family: of functions, of rigid stops, or of some that are compliant."""
    if family.functions is not None:
        return FunctionFinder(family, grid, most_impacts, deadline)
    kind = ContactFinder if any(family.pieces) else Finder
    return kind(family, grid, most_impacts, deadline)
