"""Friction at stops in the plainest way, which shares nothing with `engine.friction`.

An impact is integrated over its impulse in small steps: Coulomb's law, and the work of the normal
force for the end. A motion between stops is integrated from event to event.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp


def small_steps(
    inverse: np.ndarray, w: float, u: float, restitution: float, friction: float, steps: int = 20000
) -> tuple[float, float]:
    """Speeds into the stop and along it after an impact at w > 0 and u.

    `inverse` (2, 2) is the inverse mass matrix of the motions into the stop and along it, 1/kg.
    """
    a, b, c = inverse[0, 0], inverse[0, 1], inverse[1, 1]
    dp = 4.0 * w / a / steps
    taken = given = 0.0
    for _ in range(100 * steps):
        sticks = u == 0.0 and abs(b / c) <= friction  # a force within the cone holds it
        if u == 0.0:
            share = math.copysign(min(abs(b / c), friction), b / c)
        else:
            share = -math.copysign(friction, u)
        before, slid = w, u
        w += dp * (-a + b * share)
        u += dp * (-b + c * share)
        if slid * u < 0.0 or sticks:
            u = 0.0
        if before > 0.0:
            taken += 0.5 * (before + w) * dp
        else:
            given -= 0.5 * (before + w) * dp
        if w < 0.0 and given >= restitution**2 * taken:
            return w, u
        if w < 0.0 and restitution == 0.0:
            return w, u
    raise AssertionError("the impact has no end")


class ByEvents:
    """A path by an integrator that ends at every event. The first coordinate moves between a lower
    and an upper stop, and the second along them."""

    def __init__(
        self, law: Any, mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray,
        places: tuple[float, float], driving: Callable[[float], np.ndarray] | None = None,
    ) -> None:  # fmt: skip
        self.law, self.friction = law, law.friction or 0.0
        self.damping, self.stiffness = damping, stiffness
        self.lower, self.upper = places
        self.driving, self.n = driving, len(mass)
        self.inverse = np.linalg.inv(mass)

    def forces(self, t: float, s: np.ndarray) -> np.ndarray:
        total = self.driving(t) - self.stiffness @ s[: self.n]
        return np.asarray(total - self.damping @ s[self.n : 2 * self.n])

    def rates(self, t: float, s: np.ndarray) -> np.ndarray:
        return np.concatenate([s[self.n :], self.inverse @ self.forces(t, s)])

    def touches(self) -> list[Any]:
        return [ending(lambda t, s: s[0] - self.upper, 1.0),
                ending(lambda t, s: self.lower - s[0], 1.0)]  # fmt: skip

    def flown(self, s: np.ndarray, times: np.ndarray, **how: Any) -> np.ndarray:
        """States at the times, from that at time 0."""
        t, found = 0.0, np.zeros((len(times), len(s)))
        while t < times[-1]:
            solved = solve_ivp(
                self.rates, (t, times[-1] + 1e-9), s, events=self.events(), atol=1e-12,
                dense_output=True, **how,
            )  # fmt: skip
            inside = (times > t) & (times <= solved.t[-1])
            if inside.any():
                found[inside] = solved.sol(times[inside]).T
            t, s = float(solved.t[-1]), solved.y[:, -1].copy()
            if solved.status:
                self.change([len(each) > 0 for each in solved.t_events].index(True), t, s)
        return found


def ending(function: Any, direction: float) -> Any:
    """An event that ends an integration."""
    function.terminal, function.direction = True, direction
    return function


class ImpactsByEvents(ByEvents):
    """Between rigid stops: impacts are those of small steps, and end stuck or sliding."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.kinds = list[str]()

    def events(self) -> list[Any]:
        return self.touches()

    def change(self, which: int, t: float, s: np.ndarray) -> None:
        n, side = self.n, 1.0 if which == 0 else -1.0
        turned = self.inverse[:2, :2] * np.array([[1.0, side], [side, 1.0]])
        fine, coarse = (
            np.array(small_steps(
                turned, side * s[n], s[n + 1], self.law.coefficient, self.friction, number
            ))
            for number in (40_000, 20_000)
        )  # fmt: skip
        w, u = 2.0 * fine - coarse if fine[1] * coarse[1] > 0.0 else fine
        self.kinds.append("stuck" if u == 0.0 else "slid")
        # the impulses that make these changes move the others too
        change = np.linalg.solve(self.inverse[:2, :2], [side * w - s[n], u - s[n + 1]])
        s[n:] += self.inverse[:, :2] @ change

    def path(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        return self.flown(start, times, rtol=1e-10)


class ContactByEvents(ByEvents):
    """Between compliant stops: a touch, a leaving, the end of a slide, and where friction no longer
    bears what drives a contact that sticks."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.mode, self.side = "free", 1.0
        self.damper = self.law.damping(1.0 / self.inverse[0, 0])
        self.kinds = set[str]()

    def normal(self, s: np.ndarray) -> float:
        """Force of the stop, below 0 where it would pull."""
        deflection = s[0] - self.upper if self.side > 0.0 else self.lower - s[0]
        return float(self.law.stiffness * deflection + self.damper * self.side * s[self.n])

    def pushed(self, t: float, s: np.ndarray) -> np.ndarray:
        """Forces with that of the stop, without friction."""
        found = self.forces(t, s)
        found[0] -= self.side * max(self.normal(s), 0.0)
        return found

    def holding(self, t: float, s: np.ndarray) -> float:
        """Friction by which the speed along the stop stays as it is."""
        return float(-(self.inverse[1] @ self.pushed(t, s)) / self.inverse[1, 1])

    def rates(self, t: float, s: np.ndarray) -> np.ndarray:
        total, rubs = self.forces(t, s), 0.0
        if self.mode != "free":
            total = self.pushed(t, s)
            sliding = -self.friction * max(self.normal(s), 0.0)
            rubs = self.holding(t, s) if self.mode == "sticks" else sliding * float(self.mode)
        total[1] += rubs
        along = s[self.n + 1]
        return np.concatenate([s[self.n : 2 * self.n], self.inverse @ total, [-rubs * along]])

    def events(self) -> list[Any]:
        if self.mode == "free":
            return self.touches()
        ends = ending(lambda t, s: self.normal(s), -1.0)
        if self.mode == "sticks":
            bound = self.friction
            return [
                ends, ending(lambda t, s: abs(self.holding(t, s)) - bound * self.normal(s), 1.0)
            ]  # fmt: skip
        return [ends, ending(lambda t, s: float(self.mode) * s[self.n + 1], -1.0)]

    def change(self, which: int, t: float, s: np.ndarray) -> None:
        along = self.n + 1
        if self.mode == "free":
            self.side = 1.0 if which == 0 else -1.0
            self.mode = str(math.copysign(1.0, s[along]))
        elif which == 0:
            self.mode = "free"
        elif self.mode == "sticks":
            self.mode = str(-math.copysign(1.0, self.holding(t, s)))
            self.kinds.add("breaks loose")
        else:
            s[along] = 0.0
            holds = abs(self.holding(t, s)) <= self.friction * self.normal(s)
            self.mode = "sticks" if holds else str(-float(self.mode))
            self.kinds.add("sticks" if holds else "slides back")

    def path(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Displacements, their rates, and what friction took (times, 2 n + 1)."""
        return self.flown(np.append(start, 0.0), times, rtol=1e-9, max_step=0.02)
