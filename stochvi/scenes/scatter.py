"""A number of a scene that scatters: its mean and its standard deviation."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Tag

from stochvi.scenes.validation import Checked, NonNegative, Number


class Scatter(Checked):
    """Mean and standard deviation of a number that scatters.

    The key that holds it says what its distribution is, and when it is drawn: a restitution at each
    impact, from a beta distribution.

    Parameters
    ----------
    mean
        Mean, in the unit of the key.
    std
        Standard deviation, in the same unit; 0 for a number that does not scatter.

    See Also
    --------
    stochvi.Restitution : A restitution that scatters from impact to impact.

    Examples
    --------
    >>> from stochvi import Restitution
    >>> law = Restitution(coefficient=Scatter(mean=0.7, std=0.1))
    >>> law.restitution, round(law.restitution_mean_square, 12)
    (0.7, 0.5)
    """

    mean: Number
    std: NonNegative

    def __str__(self) -> str:
        return f"{self.mean:g} +- {self.std:g}"


def _tag(value: Any) -> str:
    return "{}" if isinstance(value, dict | Scatter) else ""


Scattered = Annotated[
    Annotated[Number, Tag("")] | Annotated[Scatter, Tag("{}")], Discriminator(_tag)
]
"""A number, or one that scatters."""
