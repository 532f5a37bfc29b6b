"""The page of limits says yes and no: each command is asked with a scene of each row."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from click.testing import CliRunner

from stochvi.cli import main
from support import CHECKOUT
from support.accuracies import quick_cases
from support.known import to_toml

PAGE = CHECKOUT / "docs" / "reference" / "limits.md"

NOISE = {"kind": "white", "on": "base", "density": 1e-3, "unit": "g2/Hz"}
MOUNT = {"kind": "isolator", "frequency_hz": 12.0, "zeta": 0.1, "mass": 1.0}
STOPS = {"clearance": 4e-3, "law": {"kind": "restitution", "coefficient": 0.7}}
PROFILE = {"kind": "psd", "profile": "mil-std-810h-truck-vertical-5hz"}


def document(**changes: Any) -> dict[str, Any]:
    return {"structure": MOUNT, "excitation": [NOISE], "impact_pair": [STOPS]} | changes


SCENES = {
    "pulses at random times": document(
        excitation=[{"kind": "pulses", "on": "base", "rate": 20.0, "impulse": 0.01}]
    ),
    "shocks of a shape": document(
        excitation=[PROFILE, {"kind": "pulses", "rate": 0.02, "shape": "half-sine",
                              "duration": "20 ms", "amplitude": 50.0}]
    ),
    "parts pressed together": document(
        excitation=[PROFILE],
        impact_pair=[{"upper": -1e-3, "law": {"kind": "viscoelastic", "stiffness": 1e5,
                                              "damping_ratio": 0.2}}],
    ),
    "sines beside noise": document(
        excitation=[PROFILE, {"kind": "sine", "amplitude": 3.0, "frequency_hz": 17.0}]
    ),
    "noise of varying level": document(
        excitation=[PROFILE | {"kurtosis": 5.0, "level_time": "2 s"}]
    ),
    "steady noise that is not Gaussian": document(excitation=[PROFILE | {"kurtosis": 5.0}]),
    "rubber, wire rope or dry friction": document(
        structure=MOUNT | {"damper": {"kind": "coulomb", "force": 0.2}}
    ),
    "a stiffness, damping or clearance that": document(
        excitation=[
            NOISE,
            {"kind": "modulation", "of": "stiffness", "amplitude": 0.1, "frequency_hz": 3.0},
        ]
    ),
    "a restitution that scatters": document(
        impact_pair=[STOPS | {"law": {"kind": "restitution",
                                      "coefficient": {"mean": 0.7, "std": 0.1}}}]
    ),
    "a restitution that falls with the speed": document(
        impact_pair=[STOPS | {"law": {"kind": "speed-restitution", "coefficient": 0.7,
                                      "at_speed": 0.1, "body": "viscoelastic"}}]
    ),
    "friction along a rigid stop": {
        "structure": {"kind": "matrices", "coordinates": ["across", "along"],
                      "mass": [[2.0, 0.3], [0.3, 2.0]], "damping": [[8.0, 0.0], [0.0, 2.0]],
                      "stiffness": [[8000.0, 0.0], [0.0, 2000.0]]},
        "excitation": [{"kind": "white", "on": each, "intensity": 1.0}
                       for each in ("across", "along")],
        "impact_pair": [{"on": "across", "tangent": "along", "clearance": 0.002,
                         "law": {"kind": "restitution", "coefficient": 0.6, "friction": 0.2}}],
    },
    "a progressive stop with a loss": document(
        impact_pair=[STOPS | {"law": {"kind": "power", "coefficient": 1e6, "loss": 4e5}}]
    ),
    "equipment that acts back": None,
    "a random force that is a function": None,
}  # fmt: skip
"""A scene for each row that names commands, by the start of its first cell; None where no scene
can say it."""

OPTIONS = {
    "simulate": "--paths 2 --duration 2",
    "impacts": "--paths 4 --duration 4",
    "history": "--duration 1",
    "spectrum": "--paths 4 --budget 2",
    "growth": "--rel-error 0.5",
    "linearise": "",
    "exact": "",
    "fokker-planck": "",
    "average": "",
    "screen": "",
    "size": "--probability 0.3 --mission 10 --rel-error 0.5",
    "reliability": "--mission 10 --rel-error 0.5",
    "damage": "--mission 10 --equipment 50:60:2 --rel-error 0.5",
    "sine": "--from 11 --to 12",
}
"""Options with which a command has little to do. Commands that need other files are left out."""


class Claim(NamedTuple):
    row: str
    command: str
    answers: bool


def rows(text: str) -> Iterator[tuple[str, str]]:
    """First two cells of each row of the table of yes and no."""
    table = text.partition("## Can it?")[2].partition("## All methods")[0]
    for line in table.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) > 2 and "**" in cells[1]:
            yield cells[0], cells[1]


def claims(text: str) -> Iterator[Claim]:
    """What the table says of the commands that it names."""
    for row, said in rows(text):
        start = next((each for each in SCENES if row.startswith(each)), None)
        if start is None or SCENES[start] is None:
            continue
        left = dict.fromkeys(OPTIONS)
        for answer, words in re.findall(r"\*\*(yes|no)\*\*([^*]*)", said):
            named = [each for each in re.findall(r"`([a-z-]+)`", words) if each in OPTIONS]
            for command in list(left) if "all others" in words else named:
                left.pop(command, None)
                yield Claim(start, command, answer == "yes")


CLAIMS = list(claims(PAGE.read_text(encoding="utf-8")))


def answers(claim: Claim, folder: Path) -> bool:
    """Whether the command takes the scene; that an answer is not accurate enough does not count."""
    scene, written = folder / "scene.toml", SCENES[claim.row]
    assert written is not None
    noises = {each["kind"] for each in written["excitation"]}
    if claim.command == "sine" and noises == {"white"}:  # a row of structures or laws
        where = written["excitation"][0].get("on", "base")
        sine = {"kind": "sine", "on": where, "amplitude": 20.0, "frequency_hz": 11.0}
        written = written | {"excitation": [sine]}
    scene.write_text(to_toml(written), encoding="utf-8")
    words = [claim.command, str(scene), *OPTIONS[claim.command].split(), "--quiet"]
    ended = CliRunner().invoke(main, words)
    assert ended.exit_code in (0, 1, 2), ended.exception
    assert ended.exit_code != 2 or " must " in ended.output or "apply" in ended.output, ended.output
    return ended.exit_code != 2


@quick_cases(
    "claim", CLAIMS, ids=lambda claim: f"{claim.row[:20]}-{claim.command}",
    keep=[k for k, claim in enumerate(CLAIMS) if not claim.answers],
)  # fmt: skip
def test_a_command_takes_and_refuses_what_the_page_says(claim: Claim, tmp_path: Path) -> None:
    assert answers(claim, tmp_path) == claim.answers


def test_every_row_that_names_commands_has_a_scene() -> None:
    named = [row for row, said in rows(PAGE.read_text("utf-8")) if re.search(r"`[a-z-]+`", said)]
    others = [row for row in named if not any(row.startswith(each) for each in SCENES)]
    assert others == [
        "a measured record with shocks or potholes", "several parts of a journey",
        "mounts and stops that differ between the units of a production",
        "a carrier that feels the mass",
    ]  # fmt: skip
    assert len(CLAIMS) > 30


def test_a_wrong_claim_is_noticed(tmp_path: Path) -> None:
    table = "## Can it?\n| a restitution that scatters | **yes** in `exact`; **no** | x |\n"
    (claim,) = claims(table)
    assert claim == Claim("a restitution that scatters", "exact", answers=True)
    assert not answers(claim, tmp_path)
