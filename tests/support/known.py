"""Scenes with known answers, and scene files with known mistakes, as data for the other tests."""

from __future__ import annotations

import copy
import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from stochvi.results.base import RESPONSE_QUANTITIES, Response
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.excitations import ConstantLoad, WhiteNoise
from stochvi.scenes.impact_laws import Restitution
from stochvi.scenes.scene import ImpactPair, Scene
from stochvi.scenes.structures import Oscillator

# Oscillators with omega = 1, b = 0.1, S0 = 0.2, that is theta = 1, in any units ---------------


@dataclass(frozen=True, kw_only=True)
class Units:
    """What the mass, the natural frequency and the length that are 1 come to in SI units."""

    mass: float = 1.0
    omega: float = 1.0
    length: float = 1.0

    def factor(self, quantity: str) -> float:
        """SI value of a quantity that is 1 where all three units are 1."""
        metres, seconds = {
            "m": (1, 0),
            "m^2": (2, 0),
            "m/s": (1, -1),
            "m^2/s^2": (2, -2),
            "m/s^2": (1, -2),
            "m^2/s^3": (2, -3),
            "1/s": (0, -1),
            "1": (0, 0),
        }[RESPONSE_QUANTITIES[quantity].unit]
        return self.length**metres * self.omega**-seconds


NATURAL = Units()
BENCH = Units(mass=2.5, omega=2.0 * math.pi * 12.0, length=1e-3)
"""2.5 kg at 12 Hz that moves by millimetres."""


def oscillator(
    lower: float | None = None,
    upper: float | None = None,
    restitution: float = 1.0,
    *,
    load: float = 0.0,
    omega: float = 1.0,
    damping: float = 0.1,
    intensity: float = 0.2,
    units: Units = NATURAL,
) -> Scene:
    """x'' + b x' + omega^2 x = f(t) + load between stops; None for no stop."""
    force = units.mass * units.length * units.omega**2
    excitations: list[WhiteNoise | ConstantLoad] = [
        WhiteNoise(intensity=intensity * force**2 / units.omega)
    ]
    if load:
        excitations.append(ConstantLoad(force=load * force))
    pairs = []
    if lower is not None or upper is not None:
        pairs.append(
            ImpactPair(
                lower=None if lower is None else lower * units.length,
                upper=None if upper is None else upper * units.length,
                law=Restitution(coefficient=restitution),
            )
        )
    return Scene(
        structure=Oscillator(
            mass=units.mass,
            damping=damping * units.mass * units.omega,
            stiffness=omega**2 * units.mass * units.omega**2,
        ),
        impact_pairs=pairs,
        excitations=excitations,
    )


def values(response: Response) -> dict[str, float]:
    """Every quantity that the response holds, by name; stops that do not exist are never hit."""
    found = {name: estimate.value for (_, name), estimate in response.estimates().items()}
    unhit = {"collision_rate_lower": 0.0, "collision_rate_upper": 0.0}
    return (unhit if response.impact_pairs else {}) | found


class ElasticStops(NamedTuple):
    """Exact answers for theta = omega = 1 and R = 1 (closed form against quadrature)."""

    lower: float | None
    upper: float | None
    mean: float
    mean_square: float
    rate_lower: float
    rate_upper: float


ELASTIC_STOPS = [
    ElasticStops(-1.0, 1.0, 0.0, 0.291125094772793, 0.141400085605346, 0.141400085605346),
    ElasticStops(
        -0.5, 1.0, 0.206631218061533, 0.215469719364086, 0.263610819024307, 0.181176889688714
    ),
    ElasticStops(None, 1.0, -0.287599970939178, 0.712400029060822, 0.0, 0.114735788249862),
    ElasticStops(None, -1.0, -1.52513527616098, 2.52513527616098, 0.0, 0.608440944992331),
]


class RigidStops(NamedTuple):
    """One row of data/reference/rigid_stops.csv: stops at -1 and 1, with errors of the values."""

    restitution: float
    values: dict[str, float]
    errors: dict[str, float]


def _read_rigid_stops() -> list[RigidStops]:
    path = data_folder() / "reference" / "rigid_stops.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = []
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        restitution = float(row.pop("restitution"))
        texts = {name: text for name, text in row.items() if text}
        rows.append(
            RigidStops(
                restitution,
                {name: float(text) for name, text in texts.items()},
                {name: _error(text, restitution) for name, text in texts.items()},
            )
        )
    return rows


def _error(text: str, restitution: float) -> float:
    """Two units of the last printed digit, as the table says; R = 1 is exact, to 15 digits."""
    if restitution == 1.0:
        return 1e-14 * float(text)
    return 2.0 * 10.0 ** -len(text.partition(".")[2])


RIGID_STOPS = _read_rigid_stops()


# First passages of the oscillator that omega = 1, zeta = 0.05 make ---------------------------

TEN_PERIODS = 20.0 * math.pi
P_AT_3, P_AT_4 = 0.0784609, 0.00274504
"""P(abs(x) passes 3 or 4 sigma in ten periods from rest), zeta = 0.05 (`first_passage`)."""
RARE = [
    (5.7, "rest", 7.290147e-7), (6.8, "rest", 7.089123e-10),
    (5.7, "stationary", 1.570058e-6), (6.8, "stationary", 1.726260e-9),
]  # fmt: skip
"""The same of higher barriers (`first_passage`, rtol = 1e-5)."""


# Scene files with one mistake each ----------------------------------------------------------

DOCUMENT: dict[str, Any] = {
    "title": "a valid scene",
    "structure": {"kind": "oscillator", "mass": 1.0, "damping": 0.1, "stiffness": 1.0},
    "impact_pair": [
        {"lower": -1.0, "upper": 1.0, "law": {"kind": "restitution", "coefficient": 1.0}}
    ],
    "excitation": [{"kind": "white", "intensity": 0.2}],
}

NOTHING = object()
"""In the place of a value: the key is left out."""


def changed(path: Sequence[str | int], value: Any) -> dict[str, Any]:
    """`DOCUMENT` with another value at one place."""
    document = copy.deepcopy(DOCUMENT)
    place: Any = document
    for part in path[:-1]:
        place = place[part]
    if value is NOTHING:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return document


class Mistake(NamedTuple):
    """A document, and what the sentence about it must name: the key, what was got, expected."""

    document: dict[str, Any]
    key: str
    got: str
    expected: str


def _in(section: str, name: str, value: Any, got: str, expected: str) -> Mistake:
    index = [] if section == "structure" else [0]
    place = ".".join([section, *map(str, index), name])
    return Mistake(changed([section, *index, name], value), place, got, expected)


def _structure(got: str, expected: str, **keys: Any) -> Mistake:
    return Mistake(
        changed(["structure"], {"kind": "oscillator"} | keys), "structure", got, expected
    )


def _excitation(got: str, expected: str, key: str = "excitation.0", **keys: Any) -> Mistake:
    return Mistake(changed(["excitation", 0], keys), key, got, expected)


def _table(got: str, expected: str, key: str = "excitation.0", **keys: Any) -> Mistake:
    whole = {"frequency_hz": [1.0, 2.0], "density": [1.0, 1.0], "unit": "N2/Hz"} | keys
    return _excitation(got, expected, key, kind="psd", **whole)


def _law(value: Any, got: str, expected: str, key: str = "coefficient") -> Mistake:
    path = ["impact_pair", 0, "law", key]
    return Mistake(changed(path, value), f"impact_pair.0.law.{key}", got, expected)


FINITE = "must be a finite number"
PHYSICAL_OR_MODAL = "frequency_hz with exactly one of zeta, Q and loss_factor"

MISTAKES = {
    "unknown section": Mistake(changed(["impact"], 1.0), "impact", "not a known", "'impact_pair'"),
    "unknown section, named as a kind": Mistake(
        changed(["white"], 1.0), "white", "not a known", "did you mean 'title'"
    ),
    "name in Python, not in files": Mistake(
        changed(["excitations"], []), "excitations", "not a known", "'excitation'"
    ),
    "unknown structure key": _in("structure", "masss", 1.0, "not a known", "'mass'"),
    "unknown key, named as a kind": _in("structure", "oscillator", 1, "not a known", "damping"),
    "unknown key in small letters": _in("structure", "q", 5.0, "not a known", "'Q'"),
    "unknown pair key": _in("impact_pair", "uper", 1.0, "not a known", "'upper'"),
    "unknown excitation key": _in("excitation", "intensty", 1.0, "not a known", "'intensity'"),
    "unknown law key": _law(1.0, "not a known", "'coefficient'", key="coeficient"),
    "wrong unit": _excitation(
        "'V^2/Hz'", "g2/Hz", "excitation.0.unit", kind="white", density=1.0, unit="V^2/Hz"
    ),
    "unit of a base on a mass": _excitation(
        "'g2/Hz'", "N2/Hz", kind="white", density=1.0, unit="g2/Hz"
    ),
    "negative mass": _in("structure", "mass", -2.5, "-2.5", "greater than 0"),
    "zero mass": _in("structure", "mass", 0.0, "0.0", "greater than 0"),
    "negative damping": _in("structure", "damping", -0.1, "-0.1", "at least 0"),
    "NaN": _in("structure", "mass", math.nan, "nan", FINITE),
    "infinity": _in("structure", "stiffness", math.inf, "inf", FINITE),
    "infinite stop": _in("impact_pair", "upper", math.inf, "inf", FINITE),
    "boolean": _in("structure", "mass", True, "True", FINITE),
    "boolean for a stop": _in("impact_pair", "lower", False, "False", FINITE),
    "text for a number": _in("structure", "mass", "1.0", "'1.0'", FINITE),
    "list for a number": _in("structure", "mass", [1.0], "[1.0]", FINITE),
    "number beyond any float": _in("structure", "mass", 10**400, "1000", FINITE),
    "number for a text": Mistake(changed(["title"], 3), "title", "3", "must be a text"),
    "restitution above 1": _law(1.2, "1.2", "in [0, 1]"),
    "restitution below 0": _law(-0.2, "-0.2", "in [0, 1]"),
    "restitution NaN": _law(math.nan, "nan", FINITE),
    "restitution missing": _law(NOTHING, "missing", ""),
    "law of another kind": _law("steel", "'steel'", "'restitution'", key="kind")._replace(
        key="impact_pair.0.law"
    ),
    "stiffness of nothing": Mistake(
        changed(["impact_pair", 0, "law"], {"kind": "elastic", "stiffness": 0.0}),
        "impact_pair.0.law.stiffness",
        "0.0",
        "greater than 0",
    ),
    "force that falls": Mistake(
        changed(
            ["impact_pair", 0, "law"],
            {"kind": "table", "deflection": [1.0, 2.0], "force": [2.0, 1.0]},
        ),
        "impact_pair.0.law",
        "1 after 2",
        "never decreases",
    ),
    "stops that cross": _in("impact_pair", "lower", 2.0, "2 and 1", "lower < upper")._replace(
        key="impact_pair.0"
    ),
    "stops that meet": _in("impact_pair", "lower", 1.0, "1 and 1", "lower < upper")._replace(
        key="impact_pair.0"
    ),
    "no stop in a pair": Mistake(
        changed(["impact_pair", 0], {"law": {"kind": "restitution", "coefficient": 1.0}}),
        "impact_pair.0",
        "",
        "at least one of lower and upper",
    ),
    "no law": Mistake(
        changed(["impact_pair", 0, "law"], NOTHING), "impact_pair.0", "", "needs law"
    ),
    "law of a stop that is not there": Mistake(
        changed(["impact_pair", 0], {"upper": 1.0, "lower_law": {"coefficient": 1.0}}),
        "impact_pair.0",
        "lower_law",
        "no lower stop",
    ),
    "two pairs of one name": Mistake(
        changed(["impact_pair"], DOCUMENT["impact_pair"] * 2),
        "impact_pair.1",
        "'stops' again",
        "a name of its own",
    ),
    "pair on another coordinate": Mistake(
        changed(["impact_pair", 0, "on"], "y"), "impact_pair.0", "'y'", "'x'"
    ),
    "no structure": Mistake(changed(["structure"], NOTHING), "structure", "missing", ""),
    "no excitation": Mistake(changed(["excitation"], NOTHING), "excitation", "missing", ""),
    "empty excitation": Mistake(changed(["excitation"], []), "excitation", "none", "at least one"),
    "excitation not a list": Mistake(
        changed(["excitation"], {"kind": "white"}), "excitation", "'white'", "must be a list"
    ),
    "unknown kind of excitation": _in("excitation", "kind", "pink", "'pink'", "'white'")._replace(
        key="excitation.0"
    ),
    "excitation without a kind": _excitation("intensity", "'kind'", intensity=0.2),
    "structure without a kind": Mistake(
        changed(["structure"], {"mass": 1.0}), "structure", "mass", "'kind'"
    ),
    "base excitation on a fixed base": _in(
        "excitation", "on", "base", "'oscillator'", "structure.kind = 'isolator'"
    )._replace(key="excitation.0"),
    "base acceleration on a fixed base": _excitation(
        "'oscillator'", "structure.kind = 'isolator'", kind="constant", acceleration=1.0
    ),
    "force without a mass": _structure(
        "none", "structure.mass", frequency_hz=1.0, zeta=0.1
    )._replace(key="excitation.0"),
    "mixture of descriptions": _structure(
        "damping, frequency_hz, zeta", "or by", mass=1.0, damping=1.0, frequency_hz=1.0, zeta=0.1
    ),
    "Q and zeta": _structure(
        "frequency_hz, zeta, Q", "exactly one of", mass=1.0, frequency_hz=1.0, zeta=0.1, Q=5.0
    ),
    "neither Q nor zeta": _structure("got frequency_hz", "exactly one of", frequency_hz=1.0),
    "zeta without a frequency": _structure("got zeta", "needs frequency_hz", zeta=0.1),
    "stiffness missing": _structure("mass, damping", PHYSICAL_OR_MODAL, mass=1.0, damping=0.1),
    "nothing but a kind": _structure("got none", PHYSICAL_OR_MODAL),
    "zero intensity": _in("excitation", "intensity", 0.0, "0.0", "greater than 0"),
    "no strength": _excitation("none", "exactly one of intensity and density", kind="white"),
    "two strengths": _excitation(
        "intensity, density", "exactly one", kind="white", intensity=1.0, density=1.0, unit="N2/Hz"
    ),
    "density without a unit": _excitation("got density", "unit", kind="white", density=1.0),
    "no load": _excitation("none", "exactly one of force", kind="constant"),
    "two loads": _excitation(
        "force, acceleration", "exactly one", kind="constant", force=1.0, acceleration=1.0
    ),
    "empty table": _table("0", "at least 2 breakpoints", frequency_hz=[], density=[]),
    "table of one row": _table("1", "at least 2 breakpoints", frequency_hz=[1.0], density=[1.0]),
    "uneven columns": _table("1 and 2", "as many densities as frequencies", density=[1.0]),
    "unsorted frequencies": _table(
        "2 before 1", "increasing frequency_hz", frequency_hz=[2.0, 1.0]
    ),
    "equal frequencies": _table("1 before 1", "increasing frequency_hz", frequency_hz=[1.0, 1.0]),
    "zero frequency": _table(
        "0.0", "greater than 0", "excitation.0.frequency_hz.0", frequency_hz=[0.0, 1.0]
    ),
    "negative density": _table(
        "-1.0", "greater than 0", "excitation.0.density.1", density=[1.0, -1.0]
    ),
    "zero density": _table("0.0", "greater than 0", "excitation.0.density.0", density=[0.0, 1.0]),
    "NaN in a table": _table("nan", FINITE, "excitation.0.density.0", density=[math.nan, 1.0]),
    "number for a column": _table("3.0", "must be a list", "excitation.0.density", density=3.0),
    "table without a unit": _excitation(
        "none", "needs unit", kind="psd", frequency_hz=[1.0, 2.0], density=[1.0, 1.0]
    ),
    "half a table": _excitation(
        "got frequency_hz", "and density", kind="psd", frequency_hz=[1.0, 2.0], unit="N2/Hz"
    ),
    "two tables": _table("profile, frequency_hz", "exactly one of", profile="navmat-p-9492"),
    "unknown profile": _excitation("'navmat'", "navmat-p-9492", kind="psd", profile="navmat"),
    "level beyond reason": _table("500", "-200..200", level_db=500.0),
    "table beyond computing": _table("1e+60", "1e+50", "excitation", density=[1.0, 1e60]),
    "file that is missing": _excitation(
        "no such file", "nope.csv", "excitation.0.file", kind="psd", file="nope.csv", unit="N2/Hz"
    ),
    "file that is a folder": _excitation(
        "a folder", "text file", "excitation.0.file", kind="psd", file=".", unit="N2/Hz"
    ),
    "frequency beyond computing": _in(
        "structure", "stiffness", 1e300, "1e+150", "1e-50 to 1e+50"
    )._replace(key="structure"),
    "intensity below computing": _in(
        "excitation", "intensity", 5e-324, "4.94066e-324", "1e-50 to 1e+50"
    )._replace(key="excitation"),
    "mass beyond computing": _in("structure", "mass", 1e-300, "1e-300", "1e-50")._replace(
        key="structure"
    ),
}


def to_toml(document: Mapping[str, Any]) -> str:
    """A scene file with these keys."""
    lines = [f"{key} = {_toml(value)}" for key, value in document.items()]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    match value:
        case dict():
            return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_toml, value)) + "]"
        case float():
            return repr(value)
        case _:
            return json.dumps(value)
