"""Impact laws: one contact of a free mass, against integration of its equation of motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from stochvi.mathematics.kelvin_voigt import identify_viscoelastic
from stochvi.results.errors import SceneError
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Elastic,
    ForceFunction,
    ForceTable,
    Hertz,
    PowerLaw,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.base import ContactMotion
from stochvi.scenes.scene import load_scene, scene_from

TABLE = ForceTable(deflection=[0.02, 0.05, 0.06], force=[1.0, 1.0, 9.0])
"""A straight rise, a plateau, and a steep end."""

LAWS = {
    "elastic": Elastic(stiffness=300.0),
    "undamped": Viscoelastic(stiffness=300.0, damping_ratio=0.0),
    "z = 0.2": Viscoelastic(stiffness=300.0, damping_ratio=0.2),
    "z = 0.6": Viscoelastic(stiffness=300.0, damping_ratio=0.6),
    "z = 0.99999": Viscoelastic(stiffness=300.0, damping_ratio=0.99999),
    "z = 1": Viscoelastic(stiffness=300.0, damping_ratio=1.0),
    "z = 1.00001": Viscoelastic(stiffness=300.0, damping_ratio=1.00001),
    "z = 3": Viscoelastic(stiffness=300.0, damping_ratio=3.0),
    "Hertz": Hertz(coefficient=900.0),
    "power": PowerLaw(coefficient=900.0, exponent=1.7),
    "table": TABLE,
    "table with a dead zone": ForceTable(deflection=[0.01, 0.02], force=[0.0, 3.0]),
}

INTEGRATED = 1e-7
"""Relative error of the integration at its tolerance, tightened until it no longer mattered."""


def push(law: CompliantLaw, y: float, v: float, mass: float) -> float:
    """The force, with the damping that belongs to this mass; before it is cut off at zero."""
    if isinstance(law, Viscoelastic):
        return law.stiffness * y + law.damping(mass) * v
    return float(law.force_at(y))


def integrate(law: CompliantLaw, speed: float, mass: float):
    """Contact of a free mass by a Runge-Kutta method of order 8, until the force is zero."""
    scale = 2.0 * law.impact(speed, mass).contact_time

    def released(t: float, state: np.ndarray) -> float:
        y, v = state
        return push(law, y, v, mass) if isinstance(law, Viscoelastic) else y

    released.terminal, released.direction = True, -1.0  # type: ignore[attr-defined]
    return solve_ivp(
        lambda t, state: [state[1], -push(law, *state, mass) / mass],
        (0.0, scale), [0.0, speed], method="DOP853", events=released,
        rtol=1e-12, atol=1e-14, max_step=scale / 400.0, dense_output=True,
    )  # fmt: skip


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_one_contact_agrees_with_its_integration(law: CompliantLaw) -> None:
    speed, mass = 0.7, 2.5
    found = law.impact(speed, mass)
    solution = integrate(law, speed, mass)
    (end,) = solution.t_events[0]
    y, v = solution.y_events[0][0]
    times = np.linspace(0.0, end, 200_001)
    path = solution.sol(times)
    if isinstance(law, Viscoelastic):
        forces = law.stiffness * path[0] + law.damping(mass) * path[1]
    else:
        forces = law.force_at(path[0])
    expected = {
        "contact_time": end,
        "restitution": -v / speed,
        "peak_deflection": path[0].max(),
        "peak_force": forces.max(),
    }
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, rel=INTEGRATED), name
    # a maximum is flat: its place is known to the grid, or to the root of the error of its height
    flat = end * math.sqrt(INTEGRATED)
    assert found.time_to_peak == pytest.approx(times[forces.argmax()], abs=flat)
    assert y >= -INTEGRATED


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_contact_with_a_stop_whose_loss_stiffens_lasts_while_it_pushes(power: float) -> None:
    """k y^n + c y^m y' ends where k y^(n - m) + c y' does, before the mass is back."""
    k, c = 900.0, 3000.0
    found = PowerLaw(coefficient=k, loss=c, loss_exponent=power).impact(0.7, 2.5)

    def ends(t: float, state: np.ndarray) -> float:
        return float(k * max(state[0], 0.0) ** (1.5 - power) + c * state[1])

    def back(t: float, state: np.ndarray) -> float:
        return float(state[0])

    ends.direction = back.direction = -1.0  # type: ignore[attr-defined]
    back.terminal = True  # type: ignore[attr-defined]

    def moves(t: float, state: np.ndarray) -> tuple[float, float]:
        y, v = max(state[0], 0.0), state[1]
        return v, -max(k * y**1.5 + c * y**power * v, 0.0) / 2.5

    solved = solve_ivp(
        moves, (0.0, 10.0), (0.0, 0.7), events=(ends, back), rtol=1e-9, atol=1e-12, max_step=1e-3,
    )  # fmt: skip
    pushed, whole = solved.t_events[0][0], solved.t_events[1][0]
    assert found.contact_time == pytest.approx(pushed, rel=1e-5)
    assert whole > 1.05 * pushed


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_the_potential_is_the_integral_of_the_force_and_the_slope_its_derivative(law) -> None:
    for y in (-0.01, 0.0, 0.015, 0.043, 0.1):
        knots = [knot for knot in (0.01, 0.02, 0.05, 0.06) if knot < y]
        work, error = quad(law.force_at, 0.0, max(y, 0.0), points=knots or None)
        assert float(law.potential_at(y)) == pytest.approx(work, abs=error + 1e-15)
        step = 1e-6
        if y > 0.0:
            # exact for straight pieces; Hertz has a third derivative of y^(-3/2) / 8 coefficient
            curved = step**2 * 0.125 * 900.0 * y**-1.5
            rounding = 1e-16 * float(law.force_at(y)) / step
            change = (law.force_at(y + step) - law.force_at(y - step)) / (2.0 * step)
            assert float(law.slope_at(y)) == pytest.approx(float(change), abs=curved + 4 * rounding)


PRINTED = [
    (0.2, 2.795354440735, 0.5717400275847, 0.820918521756, 0.756134926838),
    (0.4, None, 0.3635268607692, 0.863510092838, None),
]


@pytest.mark.parametrize(("z", "time", "restitution", "force", "deflection"), PRINTED)
def test_printed_numbers_of_the_viscoelastic_limiter(z, time, restitution, force, deflection):
    found = Viscoelastic(stiffness=1.0, damping_ratio=z).impact(1.0, 1.0)
    assert found.restitution == pytest.approx(restitution, rel=2e-13)
    assert found.peak_force == pytest.approx(force, rel=2e-12)
    if time is not None:
        assert found.contact_time == pytest.approx(time, rel=4e-13)
        assert found.peak_deflection == pytest.approx(deflection, rel=2e-12)


def test_critical_damping_is_the_limit_from_both_sides():
    at = Viscoelastic(stiffness=1.0, damping_ratio=1.0).impact(1.0, 1.0)
    assert (at.contact_time, at.restitution) == (2.0, math.exp(-2.0))
    for z in (1.0 - 1e-9, 1.0 + 1e-9):
        near = Viscoelastic(stiffness=1.0, damping_ratio=z).impact(1.0, 1.0)
        # both depend smoothly on z
        assert near == pytest.approx(at, rel=2e-9)


def test_a_contact_depends_on_the_pair_of_masses_through_the_reduced_mass():
    """Force and deflection scale with the speed; a law per unit mass is the law of 1 kg."""
    law = Viscoelastic(stiffness=300.0, damping_ratio=0.2)
    assert law.impact(1.4, 2.5).peak_force == pytest.approx(2.0 * law.impact(0.7, 2.5).peak_force)
    for law in LAWS.values():
        scaled, whole = law.per_unit_mass(2.5).impact(0.7, 1.0), law.impact(0.7, 2.5)
        assert scaled.contact_time == pytest.approx(whole.contact_time, rel=1e-14)
        assert 2.5 * scaled.peak_force == pytest.approx(whole.peak_force, rel=1e-14)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
def test_the_restitution_of_hunt_and_crossley_is_that_of_its_energy(exponent: float) -> None:
    """From m v dv/dy = -k y^n (1 + a v), whatever n, follows a w - ln(1 + a w) = -a R w -
    ln(1 - a R w)."""
    k, a, speed = 900.0, 0.8, 0.7
    found = PowerLaw(coefficient=k, exponent=exponent, loss=a * k).impact(speed, 2.5).restitution

    def balance(loss: float) -> float:
        in_, out = loss * speed, loss * found * speed
        return in_ - math.log1p(in_) + out + math.log1p(-out)

    assert balance(a) == pytest.approx(0.0, abs=1e-6)
    assert abs(balance(1.1 * a)) > 1e-3


@pytest.mark.parametrize(
    "law",
    [
        PowerLaw(coefficient=1e6, loss=1.4e7, loss_exponent=1.5),
        ForceFunction(force=lambda y, v: 1e6 * y**1.5 * (1.0 + 14.0 * v)),
    ],
    ids=["power", "function"],
)
def test_slow_impacts_are_not_those_of_the_usual_speed(law: PowerLaw | ForceFunction) -> None:
    """By the balance of energy above, 1 - R = 2 a w / 3 of slow impacts; R is .07 at 1 m/s."""
    assert law.restitution < 0.1
    assert 1.0 - law.slow_restitution == pytest.approx(2.0 / 3.0 * 14.0 * 1e-3, rel=0.02)


@pytest.mark.parametrize("hashed", [True, False])
def test_an_impact_is_integrated_once(hashed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer asks for the restitution of its stops a thousand times."""
    asked: list[float] = []
    contact = PowerLaw.contact

    def noting(law: PowerLaw, speed: float, mass: float) -> ContactMotion:
        asked.append(law.coefficient)
        return contact(law, speed, mass)

    monkeypatch.setattr(PowerLaw, "contact", noting)
    if not hashed:
        monkeypatch.setattr(PowerLaw, "__hash__", None)
    soft, stiff = (PowerLaw(coefficient=k, loss=3.7e5) for k in (1.7e6, 2.3e6))
    found = [law.restitution for law in (soft, stiff, soft.model_copy(), soft)]
    assert found[0] == found[2] == found[3] != found[1]
    assert asked == ([1.7e6, 2.3e6] if hashed else [1.7e6, 2.3e6, 1.7e6, 1.7e6])


def test_a_viscoelastic_ball_loses_with_the_fifth_root_of_the_speed() -> None:
    """1 - R = 1.15345 X - 0.79827 X^2 - (4 / 15) X^(5/2), X = (c / k) (k / M)^(2/5) w^(1/5).

    It is for slow impacts; the last term is that of a stop which only pushes (Schwager and
    Poeschel 2008)."""
    k, mass, a = 1e9, 0.03, 1e-6
    law = PowerLaw(coefficient=k, loss=1.5 * a * k, loss_exponent=0.5)
    lost = {w: 1.0 - law.impact(w, mass).restitution for w in (1e-3, 0.1)}
    for w, loss in lost.items():
        x = 1.5 * a * (k / mass) ** 0.4 * w**0.2
        assert loss == pytest.approx(1.153449 * x - 0.798267 * x**2 - 4.0 / 15.0 * x**2.5, abs=x**3)
        assert abs(loss - 1.153449 * x + 0.798267 * x**2) > x**3  # the last term is seen


@pytest.mark.parametrize("z", [0.0, 0.05, 0.139625209675, 0.3, 0.49])
def test_identification_returns_the_stop_whose_impact_was_recorded(z):
    record = Viscoelastic(stiffness=810.0, damping_ratio=z).impact(0.3, 0.1)
    found, frequency = identify_viscoelastic(record.contact_time, record.time_to_peak)
    assert found == pytest.approx(z, abs=1e-13)
    assert frequency == pytest.approx(90.0, rel=1e-12)


@pytest.mark.parametrize("times", [(1.0, 0.6), (1.0, 0.0), (1.0, -0.1), (math.inf, 0.1)])
def test_a_record_that_no_viscoelastic_stop_makes_is_refused(times):
    with pytest.raises(ValueError, match="2 time_to_peak <= contact_time"):
        identify_viscoelastic(*times)


def test_a_viscoelastic_stop_only_pushes():
    law = Viscoelastic(stiffness=100.0, damping_ratio=0.5)
    assert law.force_at([-1.0, 1.0, 1.0, 1.0], [1.0, 0.0, -20.0, 1.0]).tolist() == [
        0.0,
        100.0,
        0.0,
        110.0,
    ]


def test_a_table_is_the_same_with_and_without_its_origin():
    given = ForceTable(deflection=np.array([0.0, 0.02, 0.05, 0.06]), force=[0.0, 1.0, 1.0, 9.0])
    y = np.linspace(-0.01, 0.1, 23)
    assert np.array_equal(given.force_at(y), TABLE.force_at(y))


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"deflection": [1.0], "force": [1.0, 2.0]}, "as many entries"),
        ({"deflection": [], "force": []}, "at least one point"),
        ({"deflection": [0.0], "force": [0.0]}, "at least one point"),
        ({"deflection": [0.0, 1.0], "force": [1.0, 1.0]}, "force 0 at the deflection 0, got 1"),
        ({"deflection": [1.0, 1.0], "force": [1.0, 2.0]}, "increasing deflection, got 1 after 1"),
        ({"deflection": [1.0, 2.0], "force": [2.0, 1.0]}, "never decreases, got 1 after 2"),
        ({"deflection": [-1.0, 2.0], "force": [0.0, 1.0]}, "deflection.0 must be at least 0"),
    ],
)
def test_a_table_that_is_none_gives_a_sentence(columns, words):
    with pytest.raises(SceneError) as failure:
        ForceTable(**columns)
    assert words in str(failure.value)


@pytest.mark.parametrize("name", LAWS)
def test_the_deflection_of_a_force_is_the_largest_without_a_larger_one(name):
    """The inverse of the force at rest; on a plateau its far end, beyond the last one nowhere."""
    law = LAWS[name]
    force = np.array([-1.0, 0.0, 0.3, 1.0, 2.0, 50.0])
    y = law.deflection_at(force)
    assert law.force_at(y) == pytest.approx(np.maximum(force, 0.0), rel=1e-12)
    assert np.all(law.force_at(y * (1.0 + 1e-6) + 1e-12) > force)


def test_a_stop_that_yields_never_reaches_more_than_its_largest_force():
    law = ForceTable(deflection=[0.01, 0.02], force=[1.0, 1.0])
    assert law.deflection_at([0.5, 1.0, 2.0]).tolist() == [0.005, math.inf, math.inf]


# A table from a file ----------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "factor"), [("m,N", 1.0), ("mm,N", 1e-3)])
def test_a_bumper_from_a_file_is_the_same_as_its_numbers(tmp_path, unit, factor):
    (tmp_path / "bumper.csv").write_text("deflection,force\n0,0\n2,40\n5,400\n")
    law = ForceTable(file=str(tmp_path / "bumper.csv"), unit=unit)
    same = ForceTable(deflection=[0.0, 2.0 * factor, 5.0 * factor], force=[0.0, 40.0, 400.0])
    assert (law.deflection, law.force) == (same.deflection, same.force)
    assert law.source == "bumper.csv" and law.file is None
    assert ForceTable(**law.model_dump()) == law
    assert law.per_unit_mass(2.0).force == (0.0, 20.0, 200.0)


@pytest.mark.parametrize(
    ("heading", "unit", "factors"),
    [
        ("deflection (mm);force (kN)", None, (1e-3, 1e3)),
        ("deflection (mm);force (N)", "mm,N", (1e-3, 1.0)),
        ("Weg [cm];Kraft [N]", None, (1e-2, 1.0)),
        ("deflection;force (N)", "mm,N", (1e-3, 1.0)),
    ],
)
def test_the_headings_of_a_bumper_state_its_units(tmp_path, heading, unit, factors):
    (tmp_path / "bumper.csv").write_text(f"{heading}\n0;0\n2;40\n5;400\n")
    keys = {} if unit is None else {"unit": unit}
    law = ForceTable(file=str(tmp_path / "bumper.csv"), **keys)
    assert law.deflection == pytest.approx(np.array([0.0, 2.0, 5.0]) * factors[0], rel=1e-15)
    assert law.force == pytest.approx(np.array([0.0, 40.0, 400.0]) * factors[1], rel=1e-15)


def test_a_bumper_is_looked_for_beside_its_scene(tmp_path):
    (tmp_path / "bumper.csv").write_text("0 0\n2 40\n")
    law = '{ kind = "table", file = "bumper.csv", unit = "mm,N" }'
    (tmp_path / "scene.toml").write_text(
        '[structure]\nkind = "isolator"\nmass = 2.0\nfrequency_hz = 12.0\nzeta = 0.1\n'
        f"[[impact_pair]]\nlower = -4e-3\nupper = 5e-3\nlower_law = {law}\n"
        'upper_law = { kind = "restitution", coefficient = 0.5 }\n'
        '[[excitation]]\nkind = "white"\nintensity = 1.0\n'
    )
    scene = load_scene(tmp_path / "scene.toml")
    assert scene.impact_pairs[0].law_of("lower").deflection == (0.0, 0.002)
    assert scene_from(scene.document()) == scene  # the numbers are in it: the file may go


@pytest.mark.parametrize(
    ("keys", "content", "key", "words"),
    [
        ({}, "0 0\n2 40\n", "unit", "must be 'm,N' or 'mm,N', got none, and no unit stands above"),
        (
            {"unit": "m,N"},
            "deflection (mm),force (N)\n0,0\n2,4\n",
            "unit",
            "is 'm,N', but above column 1",
        ),
        ({"unit": "mm,N"}, "y (mm),F (kN)\n0,0\n2,4\n", "unit", "stands 'kN'"),
        ({}, "force (N),deflection (mm)\n0,0\n2,4\n", "file", "expected one of length (m, mm"),
        ({}, "deflection (mm),force\n0,0\n2,4\n", "unit", "no unit stands above column 2"),
        ({"unit": ["m", "N"]}, "0 0\n2 40\n", "unit", "got ['m', 'N']"),
        ({"unit": "in,lbf"}, "0 0\n2 40\n", "unit", "got 'in,lbf'"),
        ({"unit": "m,N"}, "", "file", "holds no rows of two numbers (deflection, force)"),
        ({"unit": "m,N"}, "0 0\n2 x\n", "file", "line 2: expected a number in column 2, got 'x'"),
        ({"unit": "m,N"}, "0 0\n2 -4\n", "force.1", "must be at least 0"),
        ({"unit": "m,N"}, "0 0\n2 4\n3 2\n", "", "force that never decreases, got 2 after 4"),
        ({"unit": "m,N", "force": [1.0]}, "0 0\n2 4\n", "", "takes file, or deflection and force"),
    ],
)
def test_a_bad_bumper_gives_a_sentence(tmp_path, keys, content, key, words):
    (tmp_path / "bumper.csv").write_text(content)
    with pytest.raises(SceneError) as failure:
        ForceTable(file=str(tmp_path / "bumper.csv"), **keys)
    assert failure.value.problems[0][0] == key
    assert words in str(failure.value)


def test_a_unit_without_a_file_is_refused():
    with pytest.raises(SceneError, match="takes unit with a file only"):
        ForceTable(deflection=[2.0], force=[40.0], unit="mm,N")


def test_a_table_that_is_changed_has_pieces_of_its_own() -> None:
    law = ForceTable(deflection=(0.1, 0.3), force=(3.0, 20.0))
    assert float(law.force_at(0.1)) == pytest.approx(3.0)
    for halved in (law.per_unit_mass(2.0), law.replace(force=(1.5, 10.0))):
        assert float(halved.force_at(0.1)) == pytest.approx(1.5)
        assert float(halved.potential_at(0.1)) == pytest.approx(float(law.potential_at(0.1)) / 2.0)
        assert halved != law and law == ForceTable(deflection=(0.1, 0.3), force=(3.0, 20.0))
