"""The laws that were fitted to a test of a stop, and the one to take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stochvi.identification.measurements import Measurement
from stochvi.results.base import Result
from stochvi.results.estimates import Estimate
from stochvi.scenes.impact_laws import ImpactLaw

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """A law with the numbers at which it fits a test best.

    Parameters
    ----------
    formula
        The law as a formula.
    numbers
        Its numbers with their standard errors, SI units.
    units
        Units of the numbers.
    residual
        Standard deviation of what was observed about the law, in the unit of the test.
    criterion
        Akaike's criterion for small samples, less that of the law where it is smallest. A law that
        is worse by 10 has hardly any support.
    rejected
        Probability that the law, if it were true, would fit so much worse than the one of the
        smallest criterion; None for that one. Below 0.05 it is rejected.

    See Also
    --------
    stochvi.identification.Identification : All laws of a test.
    """

    formula: str
    numbers: Mapping[str, Estimate]
    units: Mapping[str, str]
    residual: float
    criterion: float
    rejected: float | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Identification(Result):
    """The law of a stop that a test shows.

    Parameters
    ----------
    test
        The test.
    fits
        The laws that were fitted, by name.
    chosen
        Name of the law to take: of those that are not rejected the one with the fewest numbers.
    law
        The law itself.
    line
        The law as a line of a scene file.
    of_test
        Numbers of the test itself that were fitted beside the law, such as the speed of approach.
    curve
        What was observed (`observed`) at which `place`, and what each law predicts there.
    loop
        Deflection (m), speed (m/s) and force (N) in the contact, from the integrated record of a
        drop. The force of the `law` on that motion stands beside them. None for other tests.
    assumptions
        What the test is taken to be, a sentence each.

    See Also
    --------
    stochvi.identify : The calculation.
    """

    not_in_document = ("test", "law")

    test: Measurement
    fits: Mapping[str, LawFit]
    chosen: str
    law: ImpactLaw
    line: str
    of_test: Mapping[str, Estimate]
    curve: pd.DataFrame
    loop: pd.DataFrame | None = None
    assumptions: Sequence[str] = ()

    @property
    def best(self) -> LawFit:
        """The fit of the law to take."""
        return self.fits[self.chosen]

    def summary(self) -> str:
        """The law in a sentence."""
        numbers = ", ".join(
            f"{name} = {value} {self.best.units[name]}".rstrip()
            for name, value in self.best.numbers.items()
        )
        return f"{self.chosen}: {self.best.formula}; {numbers.replace(' [fit]', '')}"

    def to_frame(self) -> pd.DataFrame:
        """One row per number of each law, with the law's misfit."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "law": name, "number": number, "value": each.value,
                    "standard_error": each.standard_error, "unit": fit.units[number],
                    "residual": fit.residual, "criterion": fit.criterion, "rejected": fit.rejected,
                }
                for name, fit in self.fits.items()
                for number, each in fit.numbers.items()
            ]
        )  # fmt: skip

    def _document(self) -> dict[str, Any]:
        return {"method": "identify", "summary": self.summary(), **super()._document()}
