"""Units of the quantities of a response."""

from stochvi.mathematics.shown_units import (
    ACCELERATION,
    LENGTH,
    MILLIRADIANS,
    SPEED,
    ShownQuantity,
    shown_as,
)

QUANTITY_UNITS = {
    "displacement_mean": "m",
    "displacement_std": "m",
    "displacement_mean_square": "m^2",
    "velocity_std": "m/s",
    "velocity_mean_square": "m^2/s^2",
    "acceleration_std": "m/s^2",
    "upcrossing_rate": "1/s",
    "collision_rate": "1/s",
    "collision_rate_lower": "1/s",
    "collision_rate_upper": "1/s",
    "impact_speed_mean": "m/s",
    "impact_speed_rate": "m/s^2",
    "impact_speed_square_rate": "m^2/s^3",
    "peak_force": "N",
    "contact_probability": "1",
    "contact_force_lower": "N",
    "contact_force_upper": "N",
    "relative_displacement_mean": "m",
    "relative_displacement_std": "m",
    "relative_velocity_std": "m/s",
}
"""Units of all quantities of a coordinate, then of an impact pair."""

ROTATIONS = ("rx", "ry", "rz")
"""Coordinates of a rigid body that are angles, rad."""


def in_angles(owner: str, unit: str) -> str:
    """The unit of a quantity of a coordinate: radians stand for metres where it is an angle.

    >>> in_angles("z", "m/s"), in_angles("ry", "m^2/s^2")
    ('m/s', 'rad^2/s^2')
    """
    return unit.replace("m", "rad", 1) if owner in ROTATIONS else unit


ANGULAR = {
    LENGTH: MILLIRADIANS, SPEED: shown_as("rad/s"), ACCELERATION: shown_as("rad/s^2")
}  # fmt: skip
"""Quantities of an angle by those of a displacement."""


def of_angle(owner: str, quantity: ShownQuantity) -> ShownQuantity:
    """A quantity of a coordinate as it is shown: that of an angle where the coordinate is one.

    >>> of_angle("rx", LENGTH).text(0.0036), of_angle("x", LENGTH).text(0.0036)
    ('3.6 mrad', '3.6 mm')
    """
    return ANGULAR.get(quantity, quantity) if owner in ROTATIONS else quantity


def unit_of(owner: str, name: str) -> str:
    """The unit of a quantity; none of a statistic, whose function has a unit of its own."""
    return in_angles(owner, QUANTITY_UNITS[name]) if name in QUANTITY_UNITS else ""
