"""Impact laws: one contact of a free mass, against integration of its equation of motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from stochvi import (
    ImpactPair,
    Isolator,
    Matrices,
    Oscillator,
    Restitution,
    Scene,
    WhiteNoise,
    linearise,
)
from stochvi.mathematics.kelvin_voigt import damping_ratio_of, identify_viscoelastic
from stochvi.model.model import model_of
from stochvi.results.errors import SceneError
from stochvi.scenes.datasets import shipped_scene
from stochvi.scenes.excitations import ConstantLoad, Excitation, Sine
from stochvi.scenes.impact_laws import (
    CompliantLaw,
    Elastic,
    ForceFunction,
    ForceTable,
    Hertz,
    PowerLaw,
    Viscoelastic,
)
from stochvi.scenes.impact_laws.compliant import ContactMotion, youngs_modulus
from stochvi.scenes.scene import drifts, load_scene, scene_from, without_drift
from support.refusals import refusals

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


test_a_table_that_is_none_gives_a_sentence = refusals(
    ForceTable,
    ({"deflection": [1.0], "force": [1.0, 2.0]}, "as many entries"),
    ({"deflection": [], "force": []}, "at least one point"),
    ({"deflection": [0.0], "force": [0.0]}, "at least one point"),
    ({"deflection": [0.0, 1.0], "force": [1.0, 1.0]}, "force 0 at the deflection 0, got 1"),
    ({"deflection": [1.0, 1.0], "force": [1.0, 2.0]}, "increasing deflection, got 1 after 1"),
    ({"deflection": [1.0, 2.0], "force": [2.0, 1.0]}, "never decreases, got 1 after 2"),
    ({"deflection": [-1.0, 2.0], "force": [0.0, 1.0]}, "deflection.0 must be at least 0"),
)


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


# ------------------------------------------------------------------------------
# Stops given by loss factor, restitution or hardness, against contacts that are integrated.
# ------------------------------------------------------------------------------


STIFFNESS, MASS = 2.0e5, 1.7


def rebound(law: Viscoelastic, speed: float) -> float:
    """Restitution of a free mass: M y'' = -(K y + c y') integrated until the force ends."""
    damping = law.damping(MASS)

    def push(t: float, state: list[float]) -> float:
        return law.stiffness * state[0] + damping * state[1]

    def motion(t: float, state: list[float]) -> list[float]:
        return [state[1], -push(t, state) / MASS]

    push.terminal, push.direction = True, -1.0  # type: ignore[attr-defined]
    period = 2.0 * math.pi * math.sqrt(MASS / law.stiffness)
    found = solve_ivp(
        motion, (0.0, 20.0 * period), [0.0, speed], events=push, rtol=1e-11, atol=1e-15 * speed
    )
    return float(-found.y[1, -1] / speed)


@pytest.mark.parametrize("restitution", [0.95, 0.6, 0.3, 0.1])
@pytest.mark.parametrize("speed", [0.05, 3.0])
def test_a_free_mass_leaves_with_the_restitution_that_was_measured(
    restitution: float, speed: float
) -> None:
    law = Viscoelastic(stiffness=STIFFNESS, restitution=restitution, at_speed=speed)
    assert rebound(law, speed) == pytest.approx(restitution, rel=1e-8)
    assert law.restitution == pytest.approx(restitution, rel=1e-12)
    # half a period of the free oscillation is longer than the contact: its decay is another law
    logarithmic = -math.log(restitution) / math.hypot(math.pi, math.log(restitution))
    other = Viscoelastic(stiffness=STIFFNESS, damping_ratio=logarithmic)
    assert rebound(other, speed) != pytest.approx(restitution, rel=1e-8)


@pytest.mark.parametrize("restitution", [1e-200, 1e-6, 0.1, 0.5, 1.0 - 1e-9, 1.0])
def test_the_damping_ratio_of_any_restitution(restitution: float) -> None:
    law = Viscoelastic(stiffness=1.0, damping_ratio=damping_ratio_of(restitution))
    # the exponent, not the restitution, is known to twelve digits
    exponent = math.log(law.restitution)
    assert exponent == pytest.approx(math.log(restitution), rel=1e-12, abs=1e-13)


def test_a_loss_factor_is_the_energy_lost_over_that_stored() -> None:
    """In a cycle of amplitude Y at W = sqrt(K / M) a damper takes pi c W Y^2, and the spring stores
    K Y^2 / 2: their ratio is 2 pi times the loss factor."""
    law = Viscoelastic(stiffness=STIFFNESS, loss_factor=0.3)
    frequency = math.sqrt(STIFFNESS / MASS)
    lost, stored = math.pi * law.damping(MASS) * frequency, STIFFNESS / 2.0
    assert lost / stored / (2.0 * math.pi) == pytest.approx(0.3, rel=1e-12)


def test_the_modulus_of_a_hardness() -> None:
    # values of the relation as they are tabulated for rubber, MPa
    for hardness, modulus in ((30.0, 1.14), (50.0, 2.46), (60.0, 3.61), (70.0, 5.52)):
        assert youngs_modulus(hardness) / 1e6 == pytest.approx(modulus, abs=0.005)
    pad = Elastic(shore_a=60.0, area=4e-4, thickness=0.01)
    assert pad.stiffness == pytest.approx(youngs_modulus(60.0) * 0.04)
    assert pad.stiffness == Viscoelastic(
        shore_a=60.0, area=4e-4, thickness=0.01, loss_factor=0.1
    ).stiffness  # fmt: skip


test_what_says_too_little_too_much_or_the_impossible_is_refused = refusals(
    Viscoelastic,
    ({"stiffness": 1.0}, "damping_ratio is missing"),
    ({"stiffness": 1.0, "damping_rato": 0.1}, "did you mean 'damping_ratio'"),
    ({"stiffness": 1.0, "damping_ratio": 0.1, "loss_factor": 0.2}, "needs exactly one of"),
    ({"stiffness": 1.0, "loss_factor": 0.2, "at_speed": 1.0}, "needs exactly one of"),
    ({"stiffness": 1.0, "restitution": 1.2}, "restitution must be in (0, 1], got 1.2"),
    ({"stiffness": 1.0, "restitution": 0.0}, "restitution must be greater than 0, got 0.0"),
    ({"stiffness": 1.0, "loss_factor": "high"}, "loss_factor must be a finite number, got"),
    ({"stiffness": 1.0, "restitution": 0.5, "at_speed": -1.0}, "at_speed must be greater"),
    ({"shore_a": 60.0, "loss_factor": 0.1}, "takes stiffness, or shore_a with area"),
    (
        {"shore_a": 90.0, "area": 1.0, "thickness": 1.0, "loss_factor": 0.1},
        "shore_a must be from 20 to 80 Shore A, got 90",
    ),
    (
        {"shore_a": 60.0, "area": 1.0, "thickness": 1.0, "stiffness": 1.0, "loss_factor": 0.1},
        "takes stiffness, or shore_a with area",
    ),
)


def test_the_conversion_is_stated_and_the_document_needs_it_no_more() -> None:
    law = Viscoelastic(shore_a=60.0, area=4e-4, thickness=0.01, restitution=0.6, at_speed=0.5)
    scene = Scene(
        structure=Isolator(mass=1.0, stiffness=1e3, damping=1.0),
        impact_pairs=[ImpactPair(clearance=0.01, law=law)],
        excitations=[WhiteNoise(intensity=0.1)],
    )
    told = " ".join(scene.assumptions())
    for words in ("60 Shore A", "Gent 1958", "4 cm²", "restitution 0.6, measured at 0.5 m/s"):
        assert told.count(words) == 1
    keys = scene.document()["impact_pair"][0]["law"]
    assert Viscoelastic(**keys) == law and "restitution" not in keys
    assert Viscoelastic(**keys).restitution == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize("asked", [{"damping_ratio": 0.2}, {"loss_factor": 0.4}])
def test_a_ratio_of_a_tested_mass_keeps_its_damper_whatever_hits_the_stop(asked) -> None:
    tested = Viscoelastic(stiffness=STIFFNESS, mass=0.5, **asked)
    damper = 2.0 * 0.2 * math.sqrt(STIFFNESS * 0.5)
    speed = 0.7
    for mass in (0.5, MASS, 40.0):
        assert tested.damping(mass) == pytest.approx(damper, rel=1e-14)
        own = Viscoelastic(
            stiffness=STIFFNESS, damping_ratio=damper / 2.0 / (STIFFNESS * mass) ** 0.5
        )
        assert tested.impact(speed, mass) == pytest.approx(own.impact(speed, mass), rel=1e-12)
        structure = Isolator(mass=mass, stiffness=1e3 * mass, damping=10.0 * mass)
        found = [
            linearise(
                Scene(
                    structure=structure, excitations=[WhiteNoise(intensity=0.1 * mass**2)],
                    impact_pairs=[ImpactPair(clearance=0.004, law=law)],
                )
            ).to_dict()["coordinates"]["x"]
            for law in (tested, own, Viscoelastic(stiffness=STIFFNESS, **asked))
        ]  # fmt: skip
        sigma = [each["displacement_std"]["value"] for each in found]
        assert sigma[0] == pytest.approx(sigma[1], rel=1e-12)
        if mass != 0.5:  # without the mass of the test the damper is another one
            assert sigma[0] != pytest.approx(sigma[2], rel=1e-4)


def test_the_damper_of_a_test_is_that_of_every_number_of_modes() -> None:
    reed = load_scene(shipped_scene("beam"))
    tested = Viscoelastic(stiffness=2e4, damping_ratio=0.1, mass=0.5)
    for modes in (1, 4):
        structure = reed.structure.replace(modes=modes)
        pair = reed.impact_pairs[0].replace(law=tested)
        model = model_of(reed.replace(structure=structure, impact_pairs=[pair]))
        law, mass = model.stops[0].law, model.pairs[0].mass
        softer = 1.0 + 2e4 * structure.compliance({pair.on: 1.0})
        wanted = 2.0 * 0.1 * math.sqrt(2e4 * 0.5) / softer**2
        assert law.damping(mass) == pytest.approx(wanted, rel=1e-12)


# ------------------------------------------------------------------------------
# Forces between two coordinates, and motions of the whole that no stop feels.
# ------------------------------------------------------------------------------


CHAIN = Matrices(
    coordinates=("a", "b", "c"),
    mass=np.diag([1.0, 2.0, 3.0]),
    damping=np.zeros((3, 3)),
    stiffness=[[5.0, -5.0, 0.0], [-5.0, 5.0, 0.0], [0.0, 0.0, 7.0]],
)


def scene(excitation: Excitation, structure: Matrices = CHAIN) -> Scene:
    return Scene(structure=structure, excitations=[excitation])


def test_a_force_between_two_acts_on_both_in_opposite_directions() -> None:
    model = model_of(scene(WhiteNoise(between=("a", "c"), intensity=2.0)))
    assert model.white.tolist() == [[2.0, 0.0, -2.0], [0.0, 0.0, 0.0], [-2.0, 0.0, 2.0]]
    model = model_of(scene(ConstantLoad(between=("b", "a"), force=3.0)))
    assert model.constant_force.tolist() == [-3.0, 3.0, 0.0]
    noise = WhiteNoise(between=("a", "c"), intensity=2.0)
    assert scene(noise).effects() == ("white noise on a against c",)


test_what_cannot_act_between_two_is_refused = refusals(
    scene,
    (WhiteNoise(between=("a", "a"), intensity=1.0), "two different names"),
    (WhiteNoise(between=("a", "d"), intensity=1.0), "two different names"),
    (WhiteNoise(between=("a", "b"), on="a", intensity=1.0), "takes on, between or weights"),
    (WhiteNoise(between=("a", "b"), density=1.0, unit="g2/Hz"), "N2/Hz"),
    (ConstantLoad(between=("a", "b"), acceleration=1.0), "takes force"),
    (Sine(between=("a", "b"), velocity=1.0, frequency_hz=1.0), "velocity"),
    (Sine(between=("a", "c"), displacement=1.0, frequency_hz=1.0), "spring or damper"),
)


def test_a_force_between_two_needs_coordinates_with_names() -> None:
    with pytest.raises(SceneError, match="several coordinates or points only"):
        Scene(
            structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
            excitations=[WhiteNoise(between=("x", "base"), intensity=1.0)],
        )


def test_motion_seen_from_a_free_mass_is_that_of_all() -> None:
    """Accelerations of the differences, by all coordinates and by the reduced matrices."""
    random = np.random.default_rng(0)
    mass = random.normal(size=(4, 4))
    mass = mass @ mass.T + 4.0 * np.eye(4)
    springs = np.zeros((4, 4))
    springs[:2, :2] = springs[2:, 2:] = [[1.0, -1.0], [-1.0, 1.0]]
    references, motions = drifts(np.vstack([springs, 0.0 * springs]), np.array([[0, 1, -1.0, 0]]))
    assert references == [2] and motions[:, 0] == pytest.approx(np.ones(4))
    force = random.normal(size=4)
    accelerations = np.linalg.solve(mass, force)
    kept = [0, 1, 3]
    forces = without_drift(mass, references, motions)
    relative = np.linalg.solve((forces @ mass)[:, kept], forces @ force)
    assert relative == pytest.approx(accelerations[kept] - accelerations[2])


def test_two_bodies_that_drift_apart_are_each_seen_from_one_of_theirs() -> None:
    references, motions = drifts(np.zeros((8, 4)), np.array([[1.0, -1.0, 0, 0], [0, 0, 1.0, -1.0]]))
    assert sorted(references) == [1, 3]
    assert motions[references] == pytest.approx(np.eye(2))


@pytest.mark.parametrize("held", [0.0, 1e-3])
def test_a_structure_that_a_spring_or_a_stop_holds_keeps_its_coordinates(held: float) -> None:
    law = Restitution(coefficient=0.5)
    pairs = [ImpactPair(between=("a", "b"), upper=1.0, law=law)]
    if not held:
        pairs.append(ImpactPair(name="wall", on="b", lower=-1.0, law=law))
    found = Scene(
        structure=Matrices(
            coordinates=("a", "b"), mass=np.eye(2), damping=np.zeros((2, 2)),
            stiffness=np.diag([0.0, held]),
        ),
        impact_pairs=pairs,
        excitations=[WhiteNoise(on="a", intensity=1.0)],
    )  # fmt: skip
    assert found.moving == ("a", "b")
    assert model_of(found).coordinates == ("a", "b")


def test_two_free_masses_are_one_oscillator_of_their_reduced_mass() -> None:
    pressed = Scene(
        structure=Matrices(
            coordinates=("a", "b"), mass=np.diag([1.0, 3.0]), damping=np.zeros((2, 2)),
            stiffness=np.zeros((2, 2)),
        ),
        impact_pairs=[ImpactPair(between=("a", "b"), upper=0.0, law=Restitution(coefficient=0.5))],
        excitations=[
            ConstantLoad(on="b", force=-2.0), WhiteNoise(on="b", intensity=9.0),
        ],
    )  # fmt: skip
    model = model_of(pressed)
    assert model.coordinates == ("a",) and model.unit_mass == pytest.approx(0.75)
    # the acceleration of a less that of b
    assert model.load == pytest.approx(2.0 / 3.0)
    assert model.intensity == pytest.approx(1.0)
