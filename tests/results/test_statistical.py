"""The comparison of a sampled number with the truth passes and fails where it should."""

from __future__ import annotations

import re

import pytest

from stochvi.results.estimates import Estimate
from stochvi.testing import assert_agrees


@pytest.mark.parametrize(
    ("value", "error", "bias"),
    [(1.44, 0.1, 0.0), (0.56, 0.1, 0.0), (1.64, 0.1, 0.2), (1.2, 0.0, 0.25), (1.0, 0.0, 0.0)],
)
def test_a_truth_within_the_stated_errors_is_accepted(value, error, bias):
    assert_agrees(Estimate(value=value, standard_error=error, bias=bias), 1.0)


@pytest.mark.parametrize(
    ("value", "error", "bias"),
    [(1.46, 0.1, 0.0), (0.54, 0.1, 0.0), (1.66, 0.1, 0.2), (1.3, 0.0, 0.25), (1 + 1e-15, 0.0, 0.0)],
)
def test_a_truth_outside_the_stated_errors_is_refused(value, error, bias):
    with pytest.raises(AssertionError):
        assert_agrees(Estimate(value=value, standard_error=error, bias=bias), 1.0)


def test_z_narrows_the_tolerance():
    estimate = Estimate(value=1.3, standard_error=0.1)
    assert_agrees(estimate, 1.0, z=3.1)
    with pytest.raises(AssertionError):
        assert_agrees(estimate, 1.0, z=2.9)


def test_an_estimate_of_unknown_bias_cannot_be_compared():
    with pytest.raises(ValueError, match="states no bias"):
        assert_agrees(Estimate(value=1.0, bias=None), 1.0)


def test_the_message_holds_the_value_the_truth_and_the_standard_errors_between():
    with pytest.raises(AssertionError, match=re.escape("2.00(10)")) as failure:
        assert_agrees(Estimate(value=2.0, standard_error=0.1), 1.25)
    assert "1.25" in str(failure.value)
    assert "7.5 standard errors" in str(failure.value)
