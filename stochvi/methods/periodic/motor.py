"""A motor of limited power that shakes a structure against its stops (B 12.37, 12.42).

The structure takes from the motor what its damping and its impacts lose, and the speed of the motor
settles where it can give that. So the frequency of the sine is no longer given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stochvi.mathematics.arguments import shown
from stochvi.mathematics.arrays import Vector
from stochvi.methods.periodic.answer import Branch, HarmonicResponse
from stochvi.methods.periodic.family import unmet
from stochvi.model.calculations import calculation
from stochvi.model.model import Model, model_of
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations import Sine
from stochvi.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "branch", "frequency_hz", "torque", "power", "displacement_max", "impact_speed_max", "stable",
)  # fmt: skip
"""Columns of the table of regimes of a motor."""


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor whose torque falls with its speed, slope (w0 - w), and which makes a sine.

    The sine may be a crank on the spring or a rotor with an unbalance: by the balance of power the
    load of the motor is in the mean

        L(w) = P(w) / w,

    with P the power that the sine brings into the structure. Where the inertia of the motor is
    large, its speed settles where slope (w0 - w) = L(w) (B 12.37, 12.42). A regime is stable where
    the structure alone is, and the load rises faster than the torque along its branch. On the far
    side of a resonance it may fall faster: then speeds are left out (Sommerfeld's effect).

    A torque may follow the speed with a time constant T, as that of an electric motor does. The
    regimes stay where they are. A deviation s of the speed then obeys

        J T s'' + (J + T L') s' + (slope + L') s = 0,

    with the inertia J. So a load that falls along its branch, L' < 0, may also let the speed swing
    up: it does where T > -J / L'.

    Parameters
    ----------
    idle_hz
        Speed w0 without load, turns per second.
    slope
        Fall of the torque with the speed, N m s.
    lag
        Time constant T, s, with which the torque follows the speed; 0 by default.
    inertia
        Inertia J of motor and crank, kg m^2, for a torque with a lag.

    Raises
    ------
    ValueError
        If a number is not positive, or a lag has no inertia.

    See Also
    --------
    stochvi.harmonic_response : Regimes at a given frequency.

    Examples
    --------
    A crank of 2 mm on the spring of a mass with a stop:

    >>> import numpy as np
    >>> import stochvi
    >>> scene = stochvi.Scene(
    ...     structure=stochvi.Oscillator(mass=1.0, damping=0.4, stiffness=100.0),
    ...     impact_pairs=[
    ...         stochvi.ImpactPair(upper=0.02, law=stochvi.Restitution(coefficient=0.6))
    ...     ],
    ...     excitations=[stochvi.Sine(amplitude=0.2, frequency_hz=1.6)],
    ... )
    >>> response = stochvi.harmonic_response(scene, np.linspace(1.3, 2.6, 53))
    >>> table = Motor(idle_hz=1.9, slope=0.004).regimes(scene, response)
    >>> bool((table["frequency_hz"] < 1.9).all())
    True
    """

    idle_hz: float
    slope: float
    lag: float = 0.0
    inertia: float | None = None

    def __post_init__(self) -> None:
        for name in ("idle_hz", "slope", "inertia"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be greater than 0, got {value:g}")
        if not 0.0 <= self.lag < math.inf:
            raise ValueError(f"lag must be 0 s or more, got {self.lag:g}")
        if self.lag and self.inertia is None:
            raise ValueError(f"inertia must be given with a lag, got none with {self.lag:g} s")

    def torque(self, frequency_hz: Vector) -> Vector:
        """Torque at speeds in turns per second, N m.

        Parameters
        ----------
        frequency_hz
            The speeds.
        """
        return np.asarray(self.slope * 2.0 * math.pi * (self.idle_hz - np.asarray(frequency_hz)))

    def regimes(self, scene: Scene, response: HarmonicResponse) -> pd.DataFrame:
        """Where the motor settles.

        Parameters
        ----------
        scene
            The scene, with one sine and rigid stops.
        response
            Its regimes over a range of frequencies, by `harmonic_response`. Between two of these
            the answer is interpolated: their distance decides how exact it is.

        Returns
        -------
        DataFrame
            A row for each regime: `branch` of the response, `frequency_hz`, `torque` (N m), `power`
            (W), `displacement_max` (m), `impact_speed_max` (m/s) and whether it is `stable`.

        Raises
        ------
        NotApplicable
            If the scene has several sines, or stops that are not rigid, or the response is not one
            over the frequency.
        """
        import pandas as pd

        if response.key != "frequency_hz":
            raise NotApplicable(
                "motor", [f"the response must be one over frequency_hz, got {response.key}"]
            )
        rows = [
            (number, *row)
            for number, branch in enumerate(response.branches)
            for row in self._settles(scene, branch)
        ]
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def _settles(self, scene: Scene, branch: Branch) -> Iterator[tuple[float | bool, ...]]:
        """The regimes on one branch: where torque and load are equal."""
        power = sine_power(scene, branch)
        load = power / (2.0 * math.pi * branch.frequency_hz)
        excess = self.torque(branch.frequency_hz) - load
        fastest = branch.impact_speed.max(axis=1, initial=0.0)
        columns = (branch.frequency_hz, load, power, branch.displacement_max, fastest)
        lasting = branch.admissible & np.isfinite(excess)
        for i in np.flatnonzero(lasting[:-1] & lasting[1:] & (excess[:-1] * excess[1:] < 0.0)):
            share = excess[i] / (excess[i] - excess[i + 1])
            values = [float(each[i] + share * (each[i + 1] - each[i])) for each in columns]
            way = 2.0 * math.pi * (branch.frequency_hz[i + 1] - branch.frequency_hz[i])
            steepness = float(load[i + 1] - load[i]) / way
            held = self.slope + steepness > 0.0
            if self.inertia is not None:
                held = held and self.inertia + self.lag * steepness > 0.0
            yield (*values, bool(branch.stable[i] & branch.stable[i + 1]) and held)


@calculation
def sine_power(scene: Scene, branch: Branch) -> Vector:
    """Mean power that the sine brings into a structure in each regime of a branch, W.

    Only the first harmonic of the motion takes power from a sine. It follows from that of the
    impulses J = (1 + R) m w of the impacts, at the phases theta, in P periods:

        q = (K - w^2 M + i w C)^-1 (A - w / (pi P) sum of J row e^(-i theta)),
        power = Re(conj(A) i w q) / 2.

    Parameters
    ----------
    scene
        A scene with one sine and rigid stops.
    branch
        A branch of its `harmonic_response`.

    Returns
    -------
    NDArray
        (points,), W; NaN where phases are not known, as with rests on a stop.

    Raises
    ------
    NotApplicable, ValueError
        If the scene has several sines, or stops that are not rigid; if `branch` is no branch.

    See Also
    --------
    Motor : A motor that gives this power.

    Examples
    --------
    Without impacts the power is that of the damper, c w^2 a^2 / 2:

    >>> import math
    >>> import stochvi
    >>> scene = stochvi.Scene(
    ...     structure=stochvi.Oscillator(mass=1.0, damping=0.4, stiffness=100.0),
    ...     excitations=[stochvi.Sine(amplitude=0.2, frequency_hz=1.6)],
    ... )
    >>> (branch,) = stochvi.harmonic_response(scene, [1.6]).branches
    >>> (point,) = branch.at(1.6)
    >>> power = float(sine_power(scene, branch)[point])
    >>> by_damper = 0.2 * (2.0 * math.pi * 1.6 * float(branch.amplitude[point])) ** 2
    >>> round(power / by_damper, 9)
    1.0
    """
    if not isinstance(branch, Branch):
        raise ValueError(f"branch must be one of harmonic_response, got {shown(branch)}")
    model = model_of(scene)
    conditions = unmet(model)
    if len(model.sines) > 1:
        conditions.append(f"excitation must be one sine, got {len(model.sines)}")
    if conditions:
        raise NotApplicable("sine_power", conditions)
    found = [_power(_turned(scene, f), branch, i) for i, f in enumerate(branch.frequency_hz)]
    return np.array(found)


def _turned(scene: Scene, frequency_hz: float) -> Model:
    """The model with its sine at another frequency, on which its amplitude may depend."""
    changed = [
        each.model_copy(update={"frequency_hz": float(frequency_hz)})
        if isinstance(each, Sine)
        else each
        for each in scene.excitations
    ]
    return model_of(scene.model_copy(update={"excitations": tuple(changed)}))


def _power(model: Model, branch: Branch, point: int) -> float:
    (sine,) = model.sines
    known = {f"{p.name} {stop.name}": (p, stop) for p in model.pairs for stop in p.stops}
    force = sine.amplitude * np.exp(1j * sine.phase) * sine.direction
    pushed = force.copy()
    for k, name in enumerate(branch.stops):
        pair, stop = known[name]
        jump = (1.0 + stop.law.restitution) * pair.mass * branch.impact_speed[point, k]
        wave = np.exp(-1j * branch.phase[point, k]) * stop.side * pair.direction
        pushed = pushed - sine.omega / (math.pi * branch.periods) * jump * wave
    matrix = model.stiffness - sine.omega**2 * model.mass + 1j * sine.omega * model.damping
    moved = np.linalg.solve(matrix, pushed)
    return float((np.conj(force) @ (1j * sine.omega * moved)).real / 2.0)
