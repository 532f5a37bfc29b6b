"""The density of a mass between stops that give way, against adaptive integrals of exp(-U)."""

import math
from itertools import pairwise

import pytest
from scipy.integrate import quad

from stochvi.model.gibbs_law import GibbsLaw
from stochvi.model.model import LOWER, UPPER, Stop
from stochvi.scenes.impact_laws import Elastic, ForceTable, Hertz, Restitution

STEEL, BALL, WALL = Elastic(stiffness=40.0), Hertz(coefficient=30.0), Restitution(coefficient=1.0)
BUMPER = ForceTable(deflection=[0.1, 0.4], force=[0.5, 6.0])

LAWS = {
    "two springs": GibbsLaw(
        theta=0.7, omega=1.2, lower=Stop(LOWER, -0.6, STEEL), upper=Stop(UPPER, 0.9, BALL)
    ),
    "spring and wall, loaded": GibbsLaw(
        theta=1.5, omega=0.8, load=0.5,
        lower=Stop(LOWER, -0.4, WALL), upper=Stop(UPPER, 0.7, BUMPER),
    ),
    "pressed": GibbsLaw(theta=0.3, omega=1.0, upper=Stop(UPPER, -0.8, STEEL)),
    "no spring": GibbsLaw(
        theta=1.0, omega=0.0, load=-0.3,
        lower=Stop(LOWER, -0.5, BALL), upper=Stop(UPPER, 0.5, STEEL),
    ),
}  # fmt: skip


def stops_of(law: GibbsLaw) -> list[Stop]:
    return [stop for stop in (law.lower, law.upper) if stop is not None]


def potential(law: GibbsLaw, x: float) -> float:
    found = 0.5 * law.omega**2 * x * x - law.load * x
    for stop in stops_of(law):
        depth = stop.side * (x - stop.position)
        if depth > 0.0:
            found += math.inf if stop.rigid else float(stop.law.potential_at(depth))
    return found


def integral(law: GibbsLaw, weight, low: float = -8.0, high: float = 8.0) -> float:
    """Between kinks, where quad sees a smooth function."""
    kinks = [stop.position for stop in stops_of(law)]
    kinks += [stop + knot for stop in kinks for knot in (-0.4, -0.1, 0.1, 0.4)]
    edges = sorted({low, high, *(kink for kink in kinks if low < kink < high)})
    return sum(
        quad(
            lambda x: weight(x) * math.exp(-potential(law, x) / law.theta),
            one, two, epsabs=1e-13, epsrel=1e-11, limit=200,
        )[0]
        for one, two in pairwise(edges)
    )  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
def test_moments_and_contacts_are_integrals(name: str) -> None:
    law = LAWS[name]
    whole = integral(law, lambda x: 1.0)
    mean = integral(law, lambda x: x) / whole
    assert law.mean == pytest.approx(mean, abs=1e-9)
    assert law.variance == pytest.approx(integral(law, lambda x: (x - mean) ** 2) / whole, rel=1e-8)
    for stop in stops_of(law):
        if stop.rigid:
            continue
        side, place, own = stop.side, stop.position, stop.law
        ends = (place, 8.0) if side > 0 else (-8.0, place)
        contact = law.contact(stop.name)
        share = integral(law, lambda x: 1.0, *ends) / whole
        force = integral(law, lambda x: float(own.force_at(side * (x - place))), *ends) / whole  # noqa: B023
        assert contact.probability == pytest.approx(share, rel=1e-8)
        assert contact.force == pytest.approx(force, rel=1e-8)


@pytest.mark.parametrize("name", LAWS)
def test_the_peak_is_where_the_potential_is_least(name: str) -> None:
    law = LAWS[name]
    least = potential(law, law.peak)
    for away in (-1e-3, 1e-3, -0.3, 0.3):
        assert potential(law, law.peak + away) >= least


def test_what_nothing_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="hold"):
        GibbsLaw(theta=1.0, omega=0.0, load=0.1, lower=Stop(LOWER, -1.0, STEEL))
