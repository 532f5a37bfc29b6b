"""The moment closure for several coordinates and pairs: every gap keeps its own balances.

Each pair's stops are replaced by m_F + k (y - E y) + beta y' on its gap y (B 17.3, 17.38), and the
linear structure that is left is solved exactly. As for one oscillator, the gap has the density
C exp(lambda y - kappa y^2 / 2) between its stops and a Gaussian speed; m_F, k and beta are the mean
force of the stops, its covariance with y over the variance of y, and the power that impacts take
over E y'^2; lambda, kappa and the speed are those with which the linear structure answers. With
them the balances of energy and virial of the whole hold, and of the force on every coordinate.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stochvi.assemblies import Assembly, Contact, assemble
from stochvi.errors import NotApplicable, NotConverged
from stochvi.estimates import Cost, Estimate, Response, provenance
from stochvi.identities import residuals
from stochvi.linearisation import boxes
from stochvi.linearisation.forms import Form, Trial, Unknowns, choose
from stochvi.linearisation.solver import NOWHERE, START_SPEEDS, root
from stochvi.modes import LinearLaw, Modes, Substitute, linear_law, modes_of
from stochvi.pair_scales import PairScale, scales_of
from stochvi.scenes import Scene, System

METHOD = "linearise:closure"


@dataclass(frozen=True, kw_only=True)
class _Gap:
    """A pair on its own: its stops as those of a single mass, in units of its spread and speed.

    `sign` is -1 where the only stop is the lower one, which then counts as an upper one.
    """

    contact: Contact
    sign: float
    length: float
    speed: float
    system: System
    form: Form

    @classmethod
    def of(cls, contact: Contact, scale: PairScale, factor: float) -> _Gap:
        sign = -1.0 if contact.upper is None else 1.0
        length, speed = scale.deviation, factor * scale.speed
        stops = {side: sign * stop / length for side, stop, _ in contact.stops}
        laws = {side: law.restitution for side, _, law in contact.stops}
        if sign < 0.0:
            stops, laws = {"upper": stops["lower"]}, {"upper": laws["lower"]}
        system = System(
            mass=1.0,
            omega=math.sqrt(scale.curvature) * length / factor,
            damping_rate=0.0,
            moving_base=False,
            noise_on_mass=True,
            intensity=0.0,
            tables=(),
            load=sign * scale.slope * length / factor**2,
            lower=stops.get("lower"),
            upper=stops.get("upper"),
            restitution_lower=laws.get("lower"),
            restitution_upper=laws.get("upper"),
        )
        form = choose("closure", "consistent", system)
        return cls(contact=contact, sign=sign, length=length, speed=speed, system=system, form=form)

    def substitute(self, trial: Trial) -> Substitute:
        """Spring, centre and damper that stand for the stops of a trial law, SI units."""
        rate = self.speed / self.length
        away = trial.stop_force / trial.stiffness if trial.stiffness else 0.0
        return Substitute(
            spring=self.contact.mass * trial.stiffness * rate**2,
            centre=self.sign * self.length * (trial.mean - away),
            damper=self.contact.mass * trial.damping * rate,
        )


def closure(scene: Scene) -> Response:
    """Approximate stationary response of several coordinates, pairs, or signals.

    White and filtered noise, sines and loads; rigid stops of any restitution. Exact without stops,
    and for one pair that loses nothing where noise matches damping. One loose mass in a box on one
    mode under white noise is linearised at every amplitude instead, see `boxes`.

    Raises
    ------
    NotApplicable, NotConverged
        With every condition that the scene does not meet; if no response was found that is its
        own linearisation.
    """
    started = time.perf_counter()
    assembly = assemble(scene)
    unmet = _unmet_conditions(assembly)
    if unmet:
        raise NotApplicable("linearise", unmet)
    box = boxes.box_of(assembly)
    if box is not None:
        return boxes.response(scene, assembly, box, METHOD)
    modes = modes_of(assembly)
    rough = scales_of(assembly, modes, "linearise")
    if rough is None:
        raise NotApplicable(
            "linearise",
            ["every mode must be shaken, lose energy, and be held by stiffness or stops"],
        )
    gaps, trials, law = _solve(assembly, modes, *rough)
    exact = not gaps or (len(gaps) == 1 and assembly.elastic and assembly.temperature is not None)
    return _response(scene, assembly, modes, law, gaps, trials, 0.0 if exact else None, started)


def _unmet_conditions(assembly: Assembly) -> list[str]:
    unmet = assembly.not_rigid()
    if assembly.tables:
        unmet.append("excitation must be white, filtered, sine or constant, got psd")
    elif not np.any(assembly.white) and not assembly.signals:
        unmet.append("excitation must contain noise or a sine, got a constant load alone")
    return unmet


def _solve(
    assembly: Assembly, modes: Modes, law: LinearLaw, scales: Sequence[PairScale]
) -> tuple[list[_Gap], list[Trial], LinearLaw]:
    """The law of every gap with which the linear structure answers, found by Newton's method."""
    if not assembly.contacts:
        return [], [], law
    for factor in START_SPEEDS:
        gaps = [
            _Gap.of(contact, scale, factor)
            for contact, scale in zip(assembly.contacts, scales, strict=True)
        ]
        start = np.concatenate([gap.form.start(gap.system) for gap in gaps])
        unknowns = root(lambda found, gaps=gaps: _imbalance(modes, gaps, found), start)  # type: ignore[misc]
        if unknowns is not None:
            trials = _trials(gaps, unknowns)
            answer = _linearised(modes, gaps, trials)
            if answer is not None:
                return gaps, trials, answer
    raise NotConverged(
        f"{METHOD} found no response that is its own linearisation; simulate this scene."
    )


def _trials(gaps: Sequence[_Gap], unknowns: Unknowns) -> list[Trial]:
    parts = np.split(unknowns, len(gaps))
    return [gap.form.trial(gap.system, part) for gap, part in zip(gaps, parts, strict=True)]


def _linearised(modes: Modes, gaps: Sequence[_Gap], trials: Sequence[Trial]) -> LinearLaw | None:
    return linear_law(
        modes, [gap.substitute(trial) for gap, trial in zip(gaps, trials, strict=True)]
    )


def _imbalance(modes: Modes, gaps: Sequence[_Gap], unknowns: Unknowns) -> Unknowns:
    """Mean, log deviation and log speed of every gap: trial law less linear structure."""
    nowhere = np.full(len(unknowns), NOWHERE)
    try:
        with np.errstate(all="ignore"):
            trials = _trials(gaps, unknowns)
            law = _linearised(modes, gaps, trials)
            if law is None:
                return nowhere
            found = []
            for gap, trial, row in zip(gaps, trials, modes.gaps, strict=True):
                mean = gap.sign * float(row @ (modes.rest + law.mean)) / gap.length
                variance = law.variances(row, 0) / gap.length**2
                square = law.variances(row, modes.size) / gap.speed**2
                found += [
                    (trial.mean - mean) / math.sqrt(trial.variance),
                    math.log(trial.variance / variance) / 2.0,
                    math.log(trial.velocity_mean_square / square) / 2.0,
                ]
    except (ValueError, ZeroDivisionError, OverflowError, np.linalg.LinAlgError):
        return nowhere
    return np.where(np.isfinite(found), found, NOWHERE)


def _response(
    scene: Scene,
    assembly: Assembly,
    modes: Modes,
    law: LinearLaw,
    gaps: Sequence[_Gap],
    trials: Sequence[Trial],
    bias: float | None,
    started: float,
) -> Response:
    how = "exact: linear and Gaussian" if not gaps else "moment closure"
    moments: dict[tuple[str, str], float] = {}

    def estimate(value: float) -> Estimate:
        return Estimate(value=value, bias=bias, how=how)

    mean = modes.shapes @ (modes.rest + law.mean)
    coordinates: dict[str, dict[str, Estimate | None]] = {}
    for row, name in enumerate(assembly.coordinates):
        variance = law.variances(modes.shapes[row], 0)
        square = law.variances(modes.shapes[row], modes.size)
        moments |= {(name, "x"): mean[row], (name, "variance"): variance, (name, "vv"): square}
        coordinates[name] = {
            "displacement_mean": estimate(float(mean[row])),
            "displacement_std": estimate(math.sqrt(variance)),
            "displacement_mean_square": estimate(float(mean[row]) ** 2 + variance),
            "velocity_std": estimate(math.sqrt(square)),
            "velocity_mean_square": estimate(square),
            "acceleration_std": None,
            "upcrossing_rate": None,
        }
    pairs: dict[str, dict[str, Estimate | float | None]] = {}
    for gap, trial, row in zip(gaps, trials, modes.gaps, strict=True):
        sides = _sides(gap, trial)
        total = {name: sum(side[name] for side in sides.values()) for name in ("n", "f1", "f2")}
        contact = gap.contact
        for side in ("lower", "upper"):
            one = sides.get(side, dict.fromkeys(total, 0.0))
            moments |= {(contact.name, f"{name}_{side}"): one[name] for name in total}
        pairs[contact.name] = {
            "collision_rate": estimate(total["n"]),
            "collision_rate_lower": estimate(sides["lower"]["n"]) if "lower" in sides else None,
            "collision_rate_upper": estimate(sides["upper"]["n"]) if "upper" in sides else None,
            "impact_speed_mean": estimate(total["f1"] / total["n"]) if total["n"] else None,
            "impact_speed_rate": estimate(total["f1"]),
            "impact_speed_square_rate": estimate(total["f2"]),
            "peak_force": None,
            "speed_threshold": 0.0,
        }
        if np.count_nonzero(contact.direction) > 1:
            pairs[contact.name] |= {
                "relative_displacement_mean": estimate(float(row @ (modes.rest + law.mean))),
                "relative_displacement_std": estimate(math.sqrt(law.variances(row, 0))),
                "relative_velocity_std": estimate(math.sqrt(law.variances(row, modes.size))),
            }
    balances = residuals(assembly, moments | _energies(modes, law), mean.tolist())
    return Response(
        method=METHOD,
        coordinates=coordinates,
        impact_pairs=pairs,
        effects=scene.effects(),
        assumptions=[
            *scene.assumptions(),
            *(
                [
                    "every gap has the density C exp(lambda y - kappa y^2 / 2) between its stops; "
                    "its speed is Gaussian and independent of it",
                    "impact speeds are Rayleigh distributed, mean square 2 E y'^2",
                ]
                if gaps
                else []
            ),
        ],
        cost=Cost(wall_time=time.perf_counter() - started),
        warnings=[
            *_warnings(gaps, trials),
            *([boxes.NOT_IN_ATLAS] if scene.absorber is not None and bias is None else []),
        ],
        provenance=provenance(scene.document()),
        identities={
            name: Estimate(value=float(value), how=how) for name, value in balances.items()
        },
    )


def _sides(gap: _Gap, trial: Trial) -> dict[str, dict[str, float]]:
    """Rate, F1 and F2 of every stop, SI units."""
    rate = gap.speed / gap.length
    found = {}
    for side, _, _ in gap.contact.stops:
        stop = trial.upper if gap.sign < 0.0 or side == "upper" else trial.lower
        found[side] = {
            "n": stop.rate * rate,
            "f1": stop.speed_rate * rate * gap.speed,
            "f2": stop.speed_square_rate * rate * gap.speed**2,
        }
    return found


def _energies(modes: Modes, law: LinearLaw) -> dict[tuple[str, str], float]:
    """E v'M v, E (q - E q)'K (q - E q) and E v'C v."""
    n = modes.size
    displacement, velocity = (
        law.covariance[part, part]
        + sum(np.real(np.outer(wave[part], wave[part].conj())) / 2.0 for wave in law.waves)
        for part in (slice(0, n), slice(n, 2 * n))
    )
    return {
        ("", "kinetic"): float(np.trace(velocity)),
        ("", "potential"): float(modes.squares @ np.diag(displacement)),
        ("", "dissipation"): float(np.sum(modes.damping * velocity)),
    }


def _warnings(gaps: Sequence[_Gap], trials: Sequence[Trial]) -> list[str]:
    return [
        f"the gap of {gap.contact.name} leans on a stop more closely than a density "
        f"C exp(lambda y - kappa y^2 / 2) allows: raised {trial.rise:.3g}-fold at the stop"
        for gap, trial in zip(gaps, trials, strict=True)
        if trial.rise > 1.0
    ]
