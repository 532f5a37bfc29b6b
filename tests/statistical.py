"""How a sampled number is compared with the truth, under the name that the tests know."""

from stochvi.testing import assert_agrees
from stochvi.verification.testing.agreement import Z

__all__ = ["Z", "assert_agrees"]
