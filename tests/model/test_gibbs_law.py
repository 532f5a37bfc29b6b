"""The density of a mass between compliant stops, against adaptive integrals of exp(-U)."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from stochvi.model.gibbs_law import GibbsLaw, Spring
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
def test_peak_forces_follow_the_potential_within_either_stop(name: str) -> None:
    law = LAWS[name]
    for stop in stops_of(law):
        if stop.rigid:
            continue
        depths = np.array([0.05, 0.3, 0.8])
        forces = stop.law.force_at(depths)
        at = potential(law, stop.position)
        rises = [potential(law, stop.position + stop.side * y) - at for y in depths]
        exceeded = law.peak_force_exceedance(stop.name, forces)
        assert exceeded == pytest.approx(np.exp(-np.maximum(rises, 0.0) / law.theta), rel=1e-10)
        if not np.all(exceeded < 1.0):
            continue
        # the density between two forces adds up to the difference of their exceedances
        kinks = [float(force) for force in (0.5, 6.0) if forces[0] < force < forces[2]]
        whole, _ = quad(
            lambda force: float(law.peak_force_density(stop.name, force)),  # noqa: B023
            forces[0], forces[2], points=kinks or None, epsrel=1e-11,
        )  # fmt: skip
        assert whole == pytest.approx(exceeded[0] - exceeded[2], rel=1e-9)


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("power", [3.5, 5.0])
def test_moments_of_a_density_that_falls_as_a_power_hold_all_of_its_tail(
    power: float, one_sided: bool
) -> None:
    """Of p ~ (1 + x^2)^(-n / 2), E x^2 = 1 / (n - 3); on x > 0, E x = 2 Gamma(n / 2) / ((n - 2)
    sqrt(pi) Gamma((n - 1) / 2)). For n = 3.5 the tail beyond the quadrature holds 4e-4 of E x^2."""
    theta = 0.7
    law = GibbsLaw(
        theta=theta, omega=0.0, lower=Stop(LOWER, 0.0, WALL) if one_sided else None,
        spring=Spring(
            force=lambda x: theta * power * np.asarray(x) / (1.0 + np.asarray(x) ** 2),
            energy=lambda x: theta * power / 2.0 * np.log1p(np.asarray(x) ** 2),
        ),
    )  # fmt: skip
    gammas = math.exp(math.lgamma(power / 2.0) - math.lgamma((power - 1.0) / 2.0))
    mean = 2.0 * gammas / ((power - 2.0) * math.sqrt(math.pi)) if one_sided else 0.0
    assert law.mean == pytest.approx(mean, abs=1e-7)
    assert law.variance == pytest.approx(1.0 / (power - 3.0) - mean**2, rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_the_peak_is_where_the_potential_is_least(name: str) -> None:
    law = LAWS[name]
    least = potential(law, law.peak)
    for away in (-1e-3, 1e-3, -0.3, 0.3):
        assert potential(law, law.peak + away) >= least


def test_what_nothing_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="hold"):
        GibbsLaw(theta=1.0, omega=0.0, load=0.1, lower=Stop(LOWER, -1.0, STEEL))
