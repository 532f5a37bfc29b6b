"""Impacts of rods by their waves, against chains of masses and springs, and printed numbers."""

from __future__ import annotations

import numpy as np
import pytest

from stochvi.mathematics.rods import Rod, mass_on_rod, rod_on_rod, rod_on_stop

STEEL = {"area": 1e-4, "young": 2.1e11, "density": 7850.0}


def rod(length: float, **keys: object) -> Rod:
    return Rod(**{"length": length, **STEEL, **keys})


def chain(body: float | Rod, target: Rod, cells: int) -> tuple[float, float]:
    """Restitution and contact time by finite differences: a chain of masses and springs, at the
    step in which a wave runs through one cell; a body is the first mass, a rod a chain of its own
    behind a contact that only pushes."""
    dx = target.length / cells
    striker = body if isinstance(body, Rod) else None
    ahead = 0 if striker is None else round(striker.length / dx)
    masses = np.concatenate([
        np.full(ahead, 0.0 if striker is None else striker.area * striker.density * dx),
        np.full(cells, target.area * target.density * dx),
    ])  # fmt: skip
    springs = np.concatenate([
        np.full(max(ahead - 1, 0), 0.0 if striker is None else striker.area * striker.young / dx),
        [target.area * target.young / dx] * (ahead > 0),  # the contact
        np.full(cells - 1, target.area * target.young / dx),
    ])  # fmt: skip
    if striker is None:
        masses[0] = body + masses[0] / 2.0
    step = 0.5 * dx / target.wave_speed
    u, v = np.zeros(len(masses)), np.zeros(len(masses))
    v[: max(ahead, 1)] = 1.0
    time = touched = 0.0
    while time < 100.0 * target.return_time:
        pull = springs * np.diff(u)
        if ahead:
            pull[ahead - 1] = min(pull[ahead - 1], 0.0)
        force = np.diff(pull, prepend=0.0, append=0.0)
        if target.far_end == "fixed":
            force[-1] -= 2.0 * target.area * target.young / dx * u[-1]
        gain = force / masses
        push = -pull[ahead - 1] if ahead else -body * gain[0]
        touched = time if push > 0.0 else touched
        # chains ring, so that rods count as parted after a while
        if time - touched > (0.1 if ahead else 0.0) * target.length / target.wave_speed:
            break
        v += step * gain
        u += step * v
        time += step
    behind = masses[max(ahead, 1) :] @ v[max(ahead, 1) :] / target.mass
    front = v[:ahead].mean() if ahead else v[0]
    return (behind if target.far_end == "free" else 0.0) - front, time


@pytest.mark.parametrize("far_end", ["fixed", "free"])
@pytest.mark.parametrize("ratio", [0.7, 2.0, 6.0])
def test_a_body_on_a_rod_is_that_of_a_chain(far_end: str, ratio: float) -> None:
    target = rod(0.5, far_end=far_end)
    found = mass_on_rod(ratio * target.mass, target)
    coarse, fine = (chain(ratio * target.mass, target, cells) for cells in (200, 400))
    for place, value in enumerate((found.restitution, found.contact_time)):
        error = abs(fine[place] - coarse[place]) + 0.01 * value
        assert value == pytest.approx(fine[place], abs=error)
    other = mass_on_rod(1.3 * ratio * target.mass, target)
    moved = (other.restitution, other.contact_time)
    assert not np.allclose(moved, fine, rtol=0.015)


@pytest.mark.parametrize(
    ("length", "keys"), [(0.2, {}), (0.35, {"area": 3e-4}), (0.2, {"area": 0.4e-4})]
)
def test_a_rod_on_a_rod_is_that_of_two_chains(length: float, keys: dict[str, float]) -> None:
    striker, target = rod(length, **keys), rod(0.5)
    found = rod_on_rod(striker, target)
    coarse, fine = (chain(striker, target, cells)[0] for cells in (300, 600))
    assert found.restitution == pytest.approx(fine, abs=abs(fine - coarse) + 0.01)
    assert found.restitution != pytest.approx(rod_on_rod(rod(1.2 * length, **keys), target)[0])


@pytest.mark.parametrize(("ratio", "lengths"), [(1.0, 3.068), (2.0, 4.708), (4.0, 5.900)])
def test_contact_times_of_a_body_on_a_fixed_rod_are_those_printed(
    ratio: float, lengths: float
) -> None:
    """Timoshenko and Goodier, section 169, in times that a wave takes along the rod."""
    target = rod(0.5, far_end="fixed")
    found = mass_on_rod(ratio * target.mass, target)
    assert found.contact_time * target.wave_speed / target.length == pytest.approx(
        lengths, abs=6e-4
    )


def test_equal_cross_sections_give_the_ratio_of_lengths() -> None:
    for length in (0.1, 0.3, 0.5):
        assert rod_on_rod(rod(length), rod(0.5)).restitution == pytest.approx(length / 0.5)
        assert rod_on_rod(rod(0.5), rod(length)).restitution == pytest.approx(length / 0.5)
    # a rod in front of a stop is a longer rod on a stop
    found = rod_on_rod(rod(0.5), rod(0.2, far_end="fixed"))
    assert found.restitution == pytest.approx(1.0)
    assert found.contact_time == pytest.approx(rod_on_stop(rod(0.7)).contact_time)


def test_momentum_and_energy_leave_no_more_than_came() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        one, two = (
            rod(random.uniform(0.1, 1.0), area=random.uniform(0.2, 5.0) * 1e-4) for _ in range(2)
        )
        assert -1e-9 <= rod_on_rod(one, two).restitution <= 1.0 + 1e-9
    heavy = mass_on_rod(1e3 * rod(0.5).mass, rod(0.5, far_end="fixed"))
    assert heavy.restitution == pytest.approx(1.0, abs=2e-3)  # the rod is a spring


def test_what_is_no_rod_is_refused() -> None:
    with pytest.raises(ValueError, match="length must be positive"):
        rod(-1.0)
    with pytest.raises(ValueError, match="far_end must be"):
        rod(1.0, far_end="loose")
    with pytest.raises(ValueError, match="striker must be a free rod"):
        rod_on_rod(rod(1.0, far_end="fixed"), rod(1.0))
    with pytest.raises(ValueError, match="mass must be positive"):
        mass_on_rod(0.0, rod(1.0))
