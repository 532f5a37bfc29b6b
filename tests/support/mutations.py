"""Scenes, names and files changed at random, with a seed: what a command may be given at worst."""

from __future__ import annotations

import copy
import random
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from stochvi.scenes.datasets import data_folder, zoo_files
from stochvi.scenes.readers import TIME_RESPONSE
from support.known import to_toml
from support.records import write_uff

BARE = re.compile(
    r"math domain error|math range error|division by zero|divide by zero|Singular matrix|"
    r"cannot convert float|Result too large|infs or NaNs|Numerical result|invalid literal|"
    r"could not broadcast|out of bounds|zero-size|different signs|JSON compliant|must be finite|"
    r"has no attribute|object is not|not supported between|unexpected keyword|Traceback|"
    r"not positive definite|Expecting|ufunc|dtype|operand|ndarray",
)
"""Words of errors of Python and its libraries, which say nothing to a user."""

NUMBERS = (
    0, 0.0, -0.0, -1.0, 1.0, 1e-3, 1e3, 1e10, 1e-10, 1e50, 1e-50, 1e154, 1e200, -1e200, 1e308,
    -1e308, 1e-308, 5e-324, float("inf"), float("-inf"), float("nan"), 2**31, 2**63, -(2**63),
    10**40, 10**320, 1e-300, 1e300, 0.999999999999, 1.0000000001,
)  # fmt: skip
"""Numbers at which formulas break: ends of floating point, of the limits of scenes, of integers."""

NAMES = (
    "", " ", ".", "..", "../../escape", "/tmp/escape", "C:\\escape", "a/b", "nul", "[/red]",
    "[bold", ":smile:", r"$\frac{$", "$", "<b>&amp;", "a" * 300, "\x00", "\x1b[2J", "箱" * 90,
    "x\ny", "\u202e", "{0}", "%s", "base", "x", "relative", "a.b", "-rf", "~", "\\",
)  # fmt: skip
"""Names that mean something to a system, a terminal or a library of pictures."""

WRONG = ("a", True, False, [], {}, [1.0], [[1.0, 2.0]], ["a"], {"kind": "restitution"}, [[]])
"""Values of other types than a key has."""

CONTENTS = (
    b"", b"\x00" * 40, b"\xff\xfe\x00", b"1", b"1,2", b"1,2\n1,2\n1,2\n", b"5,1\n2,1\n",
    b"a,b\nc,d\n",
    b"0,1\n1,1\n", b"1,-1\n2,1\n", b"1,nan\n2,1\n", b"1,1e308\n2,1e308\n", b"1e-300,1\n1e300,1\n",
    b"1,1e10\n20,1\n40,1\n", b"1,1,1\n2,2\n", b"1;1\n2;1\n", b'"1","1"\n"2","1"\n',
    b"1,5e-324\n2,1\n", b"-5,1\n-2,1\n", b"1 1" * 3000, b"frequency_hz,density\n",
    b"\xef\xbb\xbf1,1\r\n2,1\r\n",
)  # fmt: skip
"""What a table may be instead."""

WHITE = {"kind": "white", "intensity": 0.2}
RIGID = {"kind": "restitution", "coefficient": 0.7}
SCENES: tuple[dict[str, Any], ...] = (
    {
        "title": "oscillator",
        "structure": {"kind": "oscillator", "mass": 1.0, "damping": 0.1, "stiffness": 1.0},
        "impact_pair": [{"name": "stops", "lower": -1.0, "upper": 1.0, "law": RIGID}],
        "excitation": [WHITE],
    },
    {
        "title": "soft",
        "structure": {"kind": "oscillator", "mass": 2.0, "damping": 0.2, "stiffness": 2.0},
        "impact_pair": [
            {"upper": 0.5, "law": {"kind": "viscoelastic", "stiffness": 50.0, "damping_ratio": 0.1}}
        ],
        "excitation": [WHITE, {"kind": "constant", "force": 0.1}],
    },
    {
        "title": "box",
        "structure": {"kind": "isolator", "mass": 2.3, "frequency_hz": 18.0, "Q": 5.0},
        "impact_pair": [{"lower": -0.004, "upper": 0.004, "law": RIGID}],
        "excitation": [{"kind": "psd", "file": "table.csv", "unit": "g2/Hz", "level_db": 0.0}],
    },
    {
        "title": "two masses",
        "structure": {
            "kind": "matrices", "coordinates": ["box", "mass"], "mass": [[1.0, 0.0], [0.0, 0.5]],
            "damping": [[0.3, -0.1], [-0.1, 0.2]], "stiffness": [[2.0, -0.8], [-0.8, 1.0]],
        },
        "impact_pair": [{"name": "gap", "between": ["mass", "box"], "upper": 0.5, "law": RIGID}],
        "excitation": [{"kind": "white", "on": "box", "intensity": 0.2}],
    },
    {
        "title": "absorber",
        "structure": {"kind": "oscillator", "mass": 1.0, "frequency_hz": 1.0, "zeta": 0.02},
        "absorber": {"mass": 0.05, "play": 0.2, "law": RIGID},
        "excitation": [WHITE],
    },
    {
        "title": "sine",
        "structure": {"kind": "isolator", "frequency_hz": 10.0, "zeta": 0.1},
        "impact_pair": [{"upper": 0.01, "law": {"kind": "hertz", "coefficient": 1e6}}],
        "excitation": [
            {"kind": "sine", "amplitude": 3.0, "frequency_hz": 9.0},
            {"kind": "filtered", "intensity": 0.1, "frequency_hz": 8.0, "zeta": 0.2},
        ],
    },
)  # fmt: skip
"""One scene of each kind, as plain types."""

TABLE = b"10,0.002\n20,0.01\n40,0.04\n80,0.04\n300,0.01\n500,0.004\n"

BUDGET = 0.2
"""Budget of every command, s."""

QUICK = ("--paths", "2", "--duration", "2", "--threads", "1")
COMMANDS: tuple[tuple[str, ...], ...] = (
    ("exact",), ("linearise",), ("linearise", "--form", "motion"), ("linearise", "--form", "force"),
    ("linearise", "--form", "clumps"), ("average",), ("average", "--variant", "unfolded"),
    ("fokker-planck",), ("screen",), ("first-passage", "--mission", "10"),
    ("sweep", "--method", "closure", "--vary", "structure.mass=1,2"),
    ("sweep", "--method", "exact", "--vary", "excitation.0.intensity=0.1:0.2:2"),
    ("sweep", "--method", "simulate", "--vary", "impact_pair.0.upper=0.5,1", *QUICK),
    ("simulate", *QUICK), ("simulate", *QUICK), ("impacts", *QUICK),
    ("spectrum", "--paths", "2", "--threads", "1"), ("history", "--duration", "2"), ("replay",),
)  # fmt: skip
"""Commands without the scene and the budget."""

LONG_COMMANDS: tuple[tuple[str, ...], ...] = (
    ("explain", "--threads", "1"), ("check", "--rel-error", "0.1", "--threads", "1"),
    ("size", "--probability", "0.1", "--mission", "60", "--threads", "1"),
    ("size", "--rate", "0.1", "--mission", "60", "--threads", "1"),
    ("clearance", "--gaps", "1,2", "--rel-error", "0.2", "--threads", "1"),
    ("reliability", "--mission", "60", "--rel-error", "0.3", "--threads", "1"),
    ("damage", "--mission", "60", "--equipment", "20:60", "--rel-error", "0.5", "--threads", "1"),
    ("perturbations", "--speeds", "1", "--paths", "2", "--duration", "2"),
    ("absorber", "--levels", "0", "--rel-error", "0.3", "--threads", "1"),
    ("absorber", "--mass-budget", "0.01", "--threads", "1"), ("cost", "--threads", "1"),
    ("sine",), ("basins", "--threads", "1"), ("bifurcation",), ("lifetimes", "--threads", "1"),
)  # fmt: skip
"""Commands that may need more time than their budget, for the long hunt."""

WITHOUT_BUDGET = {"judge", "profiles", "schema"}


class Mutator:
    """Changes at random; the same seed gives the same changes."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def write(self, folder: Path) -> Path:
        """Write a changed scene and its table into a folder; the path of the scene."""
        document = copy.deepcopy(self.random.choice(SCENES))
        if self.random.random() < 0.6:
            document = self._shipped(folder)
        for _ in range(self.random.choice((0, 1, 1, 1, 1, 2))):
            self._change(document)
        text = to_toml(document)
        if self.random.random() < 0.08:
            text = self._spoil(text)
        scene = folder / "scene.toml"
        scene.write_bytes(text.encode("utf-8", "replace"))
        spoilt = self.random.random() < 0.4
        (folder / "table.csv").write_bytes(self.random.choice(CONTENTS) if spoilt else TABLE)
        return scene

    def command(self, commands: tuple[tuple[str, ...], ...], out: Path) -> list[str]:
        """The words of a command, sometimes with a folder for its answers."""
        words = list(self.random.choice(commands))
        if words[0] not in WITHOUT_BUDGET:
            words += ["--budget", str(BUDGET)]
        if self.random.random() < 0.15 and words[0] not in ("explain",):
            words += ["--out", str(out)]
        return words

    def file(self, folder: Path) -> tuple[Path, list[str]]:
        """Write a scene whose file has changed, or a file of paths; what is asked of which file."""
        kind = self.random.choice(("csv", "table.csv", "uff", "mat", "toml", "paths.csv"))
        path = folder / f"changed.{kind}"
        t = np.arange(400) / 256.0
        x = np.sin(40.0 * t)
        match kind:
            case "uff":
                write_uff(path, (TIME_RESPONSE, "acceleration", t, x, "g"))
            case "mat":
                savemat(path, {"time": t, "acceleration": x})
            case "toml":
                shipped = self._shipped(folder)
                path.write_text(to_toml(shipped), encoding="utf-8")
            case "table.csv":
                path.write_bytes(TABLE)
            case "paths.csv":
                path.write_text("\n".join(f"{a},{b}" for a, b in zip(t, x, strict=True)))
            case _:
                rows = [f"{a:.6f},{b:.6e}" for a, b in zip(t, x, strict=True)]
                path.write_text("\n".join(["time (s),acceleration (g)", *rows]))
        for _ in range(self.random.choice((0, 1, 1, 1, 2))):
            path.write_bytes(self._spoilt(path.read_bytes()))
        budget = ["--budget", str(BUDGET)]
        if kind == "toml":
            return path, [self.random.choice(("screen", "linearise")), *budget]
        if kind == "paths.csv":
            return path, ["judge", "--problem", "elastic-box"]
        noise = {"kind": "psd" if kind == "table.csv" else "record", "file": path.name}
        mount = {"kind": "isolator", "frequency_hz": 12.0, "zeta": 0.1}
        pair = {"lower": -0.01, "upper": 0.01, "law": RIGID}
        scene = folder / "scene.toml"
        document = {
            "structure": mount,
            "impact_pair": [pair],
            "excitation": [noise | {"unit": "g"}],
        }
        if kind == "table.csv":
            document["excitation"] = [noise | {"unit": "g2/Hz"}]
        scene.write_text(to_toml(document), encoding="utf-8")
        return scene, [self.random.choice(("screen", "replay", "linearise")), *budget]

    def _spoilt(self, content: bytes) -> bytes:
        """The content of a file with bytes changed, cut, doubled or put in."""
        place = self.random.randrange(len(content) + 1)
        match self.random.randrange(6):
            case 0:
                return content[:place]
            case 1:
                return content[:place] + content[place // 2 :]
            case 2:
                return content[:place] + b"9" * self.random.choice((30, 200_000)) + content[place:]
            case 3:
                word = self.random.choice(
                    (b"nan", b"1e999", b'"', b",,", b"\n", b"\x00", b"\xff\xfe")
                )
                return content[:place] + word + content[place:]
            case _:
                changed = bytearray(content)
                for _ in range(self.random.choice((1, 1, 4, 64)) if content else 0):
                    changed[self.random.randrange(len(changed))] = self.random.randrange(256)
                return bytes(changed)

    def _shipped(self, folder: Path) -> dict[str, Any]:
        """A scene that ships, with the files that it names in a folder."""
        shipped = sorted((data_folder() / "scenes").glob("*.toml"))
        file = self.random.choice([*shipped, *zoo_files().values()])
        for named in file.parent.glob("*.csv"):
            shutil.copy(named, folder / named.name)
        return tomllib.loads(file.read_text("utf-8"))

    def _change(self, document: dict[str, Any]) -> None:
        """Change one place of a document, wherever in it."""
        holder, key = self.random.choice(list(_places(document)))
        value = holder[key]
        match self.random.randrange(9):
            case 0:
                del holder[key]
            case 1:
                holder[key] = copy.deepcopy(self.random.choice(WRONG))
            case 2 if isinstance(holder, dict):
                holder[self.random.choice(("on", "name", "level_db", "gravity", "lower", "Q"))] = (
                    self.random.choice((*NAMES, *NUMBERS))
                )
            case 3 if isinstance(value, list) and value:
                holder[key] = value * 2
            case 4:
                holder[key] = self.random.choice(({str(key): value}, [value], [[value]]))
            case _ if isinstance(value, str):
                holder[key] = self.random.choice(NAMES)
            case _ if isinstance(value, int | float):
                factor = self.random.choice((-1.0, 1e-6, 1e-2, 0.5, 2.0, 1e2, 1e6))
                extreme = self.random.choice(NUMBERS)
                huge = abs(value) > 10**300
                holder[key] = extreme if huge or self.random.random() < 0.4 else value * factor
            case _:
                holder[key] = copy.deepcopy(self.random.choice((*WRONG, *NUMBERS)))

    def _spoil(self, text: str) -> str:
        """Cut, double or insert something in the text of a file."""
        place, lines = self.random.randrange(len(text)), text.splitlines()
        line = self.random.randrange(len(lines))
        doubled = "\n".join([*lines[: line + 1], *lines[line:]])
        broken = text[:place] + "\x00\u202e[[" + text[place:]
        return self.random.choice((text[:place], text * 2, broken, "[" * 5000, doubled))


def _places(part: Any) -> Any:
    """Every place of a document: what holds it, and its key or index there."""
    for key in part if isinstance(part, dict) else range(len(part)):
        yield part, key
        if isinstance(part[key], dict | list):
            yield from _places(part[key])
