"""One mass between its stops, without noise, as the plan of any structure flies it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import ROWS_OF_CONTACT_PAIR, ROWS_OF_PAIR, ROWS_OF_STOP
from stochvi.engine.together import NOT_KNOWN
from stochvi.model.model import LOWER, UPPER, Pair, Stop, model_of
from stochvi.motion.choose_plan import plan_several
from stochvi.motion.kernels.modes import Steps
from stochvi.scenes.impact_laws import Law
from support.known import oscillator


class Flown(NamedTuple):
    """What a mass has done: impacts (N, F1, F2) of the lower and of the upper stop; sums over the
    contacts with each; and the largest forces so far of contacts that last."""

    sums: NDArray[np.float64]
    peaks: NDArray[np.float64]

    @classmethod
    def before(cls) -> Flown:
        """Nothing."""
        return cls(np.zeros(ROWS_OF_CONTACT_PAIR), np.zeros(2))

    def impacts(self, side: float) -> NDArray[np.float64]:
        """N, F1 and F2 of a stop."""
        return self.sums[:ROWS_OF_PAIR].reshape(2, 3)[int(side > 0.0)]

    def contacts(self, side: float) -> NDArray[np.float64]:
        """Sums over the contacts with a stop."""
        return self.sums[ROWS_OF_PAIR:].reshape(2, ROWS_OF_STOP)[int(side > 0.0)]


def still(
    stops: dict[float, tuple[float, Law]], stiffness: float, step: float, speed: float = 1.0,
    known: bool = True, finer: float = 1.0,
) -> Any:  # fmt: skip
    """The plan of a mass of 1 kg on a spring, N/m, that nothing shakes or damps, in steps, s.

    `stops` are by side, each with its position from the rest position and its law. Contacts are
    read from tables for the rms `speed` only where they are `known`; sub-steps are `finer`.
    """
    ends = {side: (place, law) for side, (place, law) in stops.items()}
    held = tuple(
        Stop(UPPER if side > 0.0 else LOWER, place, law) for side, (place, law) in ends.items()
    )
    pair = Pair("stops", np.ones(1), 1.0, False, held)
    # a scene that settles gives the scales; its noise and its damper are then taken away
    shaken = model_of(oscillator(-1.0, 1.0))
    quiet = replace(
        shaken, pairs=(pair,), stiffness=np.array([[stiffness]]), damping=np.array([[1e-18]]),
        whites=tuple((1e-36, direction) for _, direction in shaken.whites),
        rates=(math.sqrt(stiffness), 1e-18),
    )  # fmt: skip
    soft = replace(shaken, pairs=(replace(pair, stops=held),))
    plan = plan_several(soft, 0.0, 1.0)
    scales = tuple(each._replace(speed=speed) for each in plan.pairs)
    plan = replace(plan, model=quiet, pairs=scales, step=step)
    if not known:
        object.__setattr__(plan, "_known_contacts", lambda stops, responses: NOT_KNOWN)
    if finer != 1.0:
        plan.__dict__["_fastest_of_contacts"] = finer
    return plan


def fly(x: float, v: float, steps: int, plan: Any, flown: Flown) -> tuple[float, float]:
    """Displacement and velocity after some steps, without noise."""
    state, sums = np.array([[x], [v]]), np.zeros((plan.rows_of_sums, 1))
    paths = plan.paths_of(state, np.ones((2, 1), np.uint64), sums)
    paths.peaks[0, 0] = flown.peaks
    plan._advance(paths, Steps(0, steps, steps))
    counted = plan.of_pairs(sums)[0, :, 0]
    flown.sums[: len(counted)] += counted  # no contact lasts where all stops are rigid
    flown.peaks[:] = paths.peaks[0, 0]
    return float(state[0, 0]), float(state[1, 0])
