"""What the first paths of a plan take: no more is begun than there is time for."""

from __future__ import annotations

import math
from collections.abc import Sequence

from stochvi.methods.monte_carlo.plan import RELAXATIONS, Plan
from stochvi.methods.monte_carlo.response_sampler import FIRST_STEPS, MORE_STEPS
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotConverged
from stochvi.results.machine import thread_seconds
from stochvi.sampling.blocks import FEWEST_AT_ONCE, PIECE_SECONDS, SHORTEST

PRICE_SHARE, LEAST_PRICE, MOST_PRICE = 0.02, 0.05, 0.25
"""Fraction of the time left after which a trial is long enough to predict the time of a path. Its
smallest and largest values in s follow."""

GROWN_SHARE = 0.25
"""A trial has enough steps if this share of its time comes on top of that of the first trial."""

PATIENCE_SECONDS = 0.5
"""Seconds beyond the budget that the first two paths may take, without which there is no answer."""


def seconds_of_first_paths(
    plan: Plan, seed: int, deadline: Deadline, paths: int = FEWEST_AT_ONCE, share: float = 1.0
) -> float:
    """CPU seconds that the first `paths` paths take for a share of their steps, predicted from
    their first ones.

    Some works on paths cannot be interrupted, and the number of impacts in a step is not known in
    advance. The trials become longer until the prediction is short, or rests on a fair share of
    the time that is left. What a trial takes before its first step, to draw the states from which
    paths start, does not grow with its steps: the prediction rests on the seconds by which a trial
    takes longer than the first one. It is 0 without a deadline, and for plans that synthesise
    paths: the price of their blocks does not grow with the number of steps that are asked for.
    """
    steps, wanted = FIRST_STEPS, share * plan.steps_per_path
    enough = max(min(PRICE_SHARE * deadline.left, MOST_PRICE), LEAST_PRICE)
    longer = plan.shortest(MORE_STEPS * steps).steps_per_path > plan.shortest(steps).steps_per_path
    if not longer or math.isinf(deadline.moment):
        return 0.0
    first = plan.shortest(steps)
    _seconds_of(first, seed, paths)  # kernels are loaded where they are called first
    at_least = took = _seconds_of(first, seed, paths)
    made = first.steps_per_path
    while steps < wanted:
        if took * wanted / made <= PIECE_SECONDS:
            return took * wanted / made
        if took >= deadline.left:
            return took
        more = took - at_least
        if took >= enough and more >= GROWN_SHARE * took:
            return at_least + more * (wanted - first.steps_per_path) / (made - first.steps_per_path)
        # the last trial is not much longer than it has to be
        longest = 1.0 + max(enough, at_least) / max(more or took, SHORTEST)
        steps = math.ceil(steps * min(MORE_STEPS, longest))
        trial = plan.shortest(steps)
        took, made = _seconds_of(trial, seed, paths), trial.steps_per_path
    return 0.0


def _seconds_of(trial: Plan, seed: int, paths: int) -> float:
    """CPU seconds that some paths take."""
    began = thread_seconds()
    trial.averages(seed, 0, paths)
    return thread_seconds() - began


def check_price(
    plans: Sequence[Plan], seed: int, deadline: Deadline, paths: int = FEWEST_AT_ONCE,
    whole: bool = True,
) -> None:  # fmt: skip
    """Raise `NotConverged` where the first paths by each of these plans take longer than there is,
    and `Interrupted` where Ctrl-C came before they were begun.

    Where paths need not be `whole` they may end a relaxation time after their burn-in.
    """
    seconds = 0.0
    for plan in plans:
        least = plan.burn_in * (1.0 + 1.0 / RELAXATIONS)
        share = 1.0 if whole else min(1.0, least / (plan.burn_in + plan.duration))
        seconds += seconds_of_first_paths(plan, seed, deadline, paths, share)
        if deadline.interrupted:
            raise deadline.fell_short("before any path was simulated", "")
        if seconds > deadline.left + PATIENCE_SECONDS:
            what = "" if whole else "the burn-in of "
            raise NotConverged(
                f"the budget of {deadline.budget:g} s is too short for {what}{paths} paths, "
                f"which take at least {seconds:.2g} s, of which {deadline.left:.2g} s are left; "
                "raise budget, or shorten the paths (duration)"
            )
