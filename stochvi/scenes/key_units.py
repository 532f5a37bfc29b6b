"""Units of the numbers in a scene file, by key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

KEY_UNITS = {
    "lower": "m",
    "upper": "m",
    "clearance": "m",
    "at": "m",
    "inertia": "kg m2",
    "centre_tolerance": "m",
    "play": "m",
    "deflection": "m",
    "thickness": "m",
    "length": "m",
    "width": "m",
    "height": "m",
    "second_moment": "m4",
    "young": "Pa",
    "tip_mass": "kg",
    "tip_spring": "N/m",
    "modal_mass": "kg",
    "residual_compliance": "m/N",
    "max_frequency_hz": "Hz",
    "area": "m2",
    "mass": "kg",
    "body_mass": "kg",
    "wheel_mass": "kg",
    "damping": "N s/m",
    "suspension_damping": "N s/m",
    "tyre_damping": "N s/m",
    "stiffness": "N/m",
    "suspension_stiffness": "N/m",
    "tyre_stiffness": "N/m",
    "force": "N",
    "acceleration": "m/s2",
    "frequency_hz": "Hz",
    "band_hz": "Hz",
    "resolution_hz": "Hz",
    "fs": "Hz",
    "level_db": "dB",
    "level_time": "s",
    "duration": "s",
    "from_hz": "Hz",
    "to_hz": "Hz",
    "width_hz": "Hz",
    "speed": "m/s",
    "rate": "1/s",
    "at_speed": "m/s",
    "displacement": "m",
    "velocity": "m/s",
    "speed_kmh": "km/h",
    "roughness": "m3",
    "yield_displacement": "m",
    "linear_stiffness": "N/m",
    "cubic_stiffness": "N/m3",
    "linear_damping": "N s/m",
    "cubic_damping": "N s3/m3",
    "reverses_above": "m",
    "reverses_below": "m",
    "delay": "s",
}
"""Units of the keys that have the same unit everywhere in a scene file."""


def key_unit(document: Mapping[str, Any], part: Mapping[str, Any], name: str) -> str:
    """The unit of the key `name` of a part of a scene; empty for a number without a unit.

    Examples
    --------
    >>> key_unit({}, {"kind": "isolator"}, "frequency_hz")
    'Hz'
    >>> key_unit({}, {"kind": "white", "unit": "g2/Hz"}, "density")
    'g2/Hz'
    """
    match part.get("kind"), name:
        case "bar" | "beam" | "plate", "density":
            return "kg/m3"
        case "modulation", "intensity" | "density":
            return "s"
        case _, "density":
            return str(part.get("unit", ""))
        case "hertz", "coefficient":
            return "N/m^1.5"
        case "power", "coefficient":
            return f"N/m^{part.get('exponent', 1.5):g}"
        case "power", "loss":
            power = part.get("loss_exponent") or part.get("exponent", 1.5)
            return f"N s/m^{power + 1.0:g}"
        case "van-der-pol", "amplitude":
            return "m"
        case ("sine" | "function" | "pulses", "amplitude") | ("pulses", "impulse"):
            on_mount = document["structure"]["kind"] == "isolator"
            on_base = part.get("on", "base" if on_mount else "") == "base"
            units = ("m/s", "N s") if name == "impulse" else ("m/s2", "N")
            return str(part.get("unit") or units[0 if on_base else 1])
    return KEY_UNITS.get(name, "")
