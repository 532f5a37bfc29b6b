"""Rigid stops: an impact is instantaneous, and its loss of energy follows from a restitution."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.beta_distribution import BetaDistribution
from stochvi.mathematics.impact_rates import equivalent_restitution
from stochvi.scenes.impact_laws.base import Form, RigidLaw
from stochvi.scenes.scatter import Scatter, Scattered


class Restitution(RigidLaw):
    """Newton's law of impact on a rigid stop, v+ = -R v-, 0 <= R <= 1 (B section 1).

    Parameters
    ----------
    coefficient
        The restitution R; 1 loses nothing, 0 loses all of the normal velocity. The energy
        lost in one impact of incident speed w is (1 - R^2) m w^2 / 2. A `Scatter`, or a table of
        mean and std, is drawn anew at each impact from a beta distribution on [0, 1], independent
        of the speed. Its std must be below sqrt(mean (1 - mean)).

    See Also
    --------
    stochvi.Scatter : A restitution that scatters from impact to impact.
    stochvi.SpeedRestitution : A restitution that depends on the speed.
    stochvi.Viscoelastic : A compliant stop.

    Examples
    --------
    >>> Restitution(coefficient=0.8).coefficient
    0.8
    >>> round(Restitution(coefficient={"mean": 0.7, "std": 0.1}).restitution_mean_square, 12)
    0.5
    """

    kind: Literal["restitution"] = "restitution"
    coefficient: Scattered

    @field_validator("coefficient")
    @classmethod
    def _between_nothing_and_all(cls, value: float | Scatter) -> float | Scatter:
        mean, std = (value.mean, value.std) if isinstance(value, Scatter) else (value, 0.0)
        if not 0.0 <= mean <= 1.0:
            raise ValueError(f"must be in [0, 1], got {mean:g}")
        if std and not std < (largest := math.sqrt(mean * (1.0 - mean))):
            raise ValueError(
                f"must have std below sqrt(mean (1 - mean)) = {largest:.4g}, got {std:g}; give a "
                "smaller std"
            )
        return value

    @cached_property
    def scatter(self) -> BetaDistribution | None:
        """The distribution from which R is drawn at each impact; None where R does not scatter."""
        value = self.coefficient
        if isinstance(value, Scatter) and value.std > 0.0:
            return BetaDistribution(value.mean, value.std)
        return None

    @property
    def remark(self) -> str:
        """That the restitution scatters, and that the stop rubs, if it does."""
        drawn = "" if self.scatter is None else ", restitution drawn at each impact"
        return drawn + super().remark

    @property
    def conservative(self) -> bool:
        """Whether an impact loses no energy."""
        return self.restitution == 1.0 and not self.friction

    @cached_property
    def restitution(self) -> float:
        """Restitution R of an impact; its mean where R scatters."""
        value = self.coefficient
        return value.mean if isinstance(value, Scatter) else value

    @cached_property
    def restitution_mean_square(self) -> float:
        """E R^2: an impact takes (1 - E R^2) m w^2 / 2 in the mean."""
        law = self.scatter
        return self.restitution**2 + (0.0 if law is None else law.std**2)

    @property
    def slow_restitution(self) -> float:
        """The constant restitution that leaves slow impacts under white noise the same density,
        where R scatters (`mathematics.impact_rates.equivalent_restitution`); else R."""
        law = self.scatter
        return self.restitution if law is None else equivalent_restitution(law)

    def shifted(self, amount: float) -> Restitution:
        """The law with a number added to R, or to its mean, as far as [0, 1] and its std let it."""
        law = self.scatter
        if law is None:
            return self.replace(coefficient=min(max(self.restitution + amount, 0.0), 1.0))
        # mean (1 - mean) > std^2, with a margin that keeps a distribution
        half = MOST_SHIFTED * math.sqrt(max(0.25 - law.std**2, 0.0))
        mean = min(max(law.mean + amount, 0.5 - half), 0.5 + half)
        return self.replace(coefficient=Scatter(mean=mean, std=law.std))

    def restitution_at(self, speed: ArrayLike) -> Vector:
        """R of impacts at the given speeds (m/s): the same for all; its mean where R scatters."""
        return np.full(np.shape(speed), self.restitution)

    def in_words(self) -> str:
        drawn = "" if self.scatter is None else f" +- {self.scatter.std:g}, drawn at each impact"
        return f"rigid, restitution {self.restitution:g}{drawn}"

    def compiled(self) -> NamedTuple:
        from stochvi.engine.laws.restitution import Restitution as Compiled
        from stochvi.engine.laws.scattered_restitution import ScatteredRestitution

        law = self.scatter
        return Compiled(self.restitution) if law is None else ScatteredRestitution.of(law)

    def form(self) -> Form | None:
        if self.scatter is not None:
            return None
        return Form("rigid", np.array([[self.restitution]]))


MOST_SHIFTED = 0.98
"""How far from 0.5 the mean of a restitution is shifted, as a share of the way to where its std
leaves no distribution."""
