"""stochvi size: the verdict, the document, the files, and what it refuses."""

import math
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
import pytest
from test_cli import ISOLATOR, Run, one_document, stochvi  # noqa: F401

from stochvi.scenes import load_scene
from stochvi.sizing import size
from stochvi.sizing_plots import plot_risk
from stochvi.sizings import spoken_percent

ROUGH = ("--rel-error", "0.2", "--threads", "1", "--mission", "600")


def test_the_clearance_and_what_three_sigma_buys(stochvi: Run, tmp_path: Path) -> None:  # noqa: F811
    done = stochvi(
        "size", ISOLATOR, "--probability", "0.05", *ROUGH, "--json", "-", "--out", tmp_path
    )  # fmt: skip
    assert done.code == 0
    document = one_document(done.out)
    assert document["method"] == "size" and document["mission"] == 600.0
    clearance = document["clearance"]
    assert clearance["lower"] < clearance["value"] < clearance["upper"]
    first = done.err.splitlines()[0]
    assert first.startswith(f"{1e3 * clearance['value']:.4g} mm per side")
    assert "hits, simulated" in done.err
    by_python = size(
        load_scene(ISOLATOR), probability=0.05, mission=600.0, rel_error=0.2, threads=1
    )
    assert clearance["value"] == by_python.clearance.value
    for name in ("risk.csv", "required.csv", "hits.csv", "size.json"):
        assert (tmp_path / name).stat().st_size > 0
    assert (tmp_path / "risk.png").read_bytes().startswith(b"\x89PNG")
    curve = pd.read_csv(tmp_path / "risk.csv")
    assert (curve["probability"].between(0.0, 1.0)).all()


WHITE = """
[structure]
kind = "isolator"
frequency_hz = 10.0
zeta = 0.2
[[excitation]]
kind = "white"
density = 0.01
unit = "g2/Hz"
"""


def test_a_changed_scene_stands_beside_it(stochvi: Run, tmp_path: Path) -> None:  # noqa: F811
    scene = tmp_path / "white.toml"
    scene.write_text(WHITE, encoding="utf-8")
    done = stochvi(
        "size", scene, "--probability", "0.05", *ROUGH, "--json", "-", "--out", tmp_path,
        "--sensitivity",
    )  # fmt: skip
    assert done.code == 0
    changes = [row["change"] for row in one_document(done.out)["sensitivity"]]
    assert changes[0] == "none" and "level +3 dB" in changes
    assert "level +3 dB" in done.err and "no stops" in done.err
    assert list(pd.read_csv(tmp_path / "sensitivity.csv")["change"]) == changes


def test_the_picture_holds_rice_three_sigma_and_the_answer() -> None:
    sizing = size(load_scene(ISOLATOR), probability=0.05, mission=600.0, rel_error=0.2)
    ax = plot_risk(sizing)
    rice, risk, three, answer = ax.get_lines()[:4]
    assert (risk.get_ydata() <= rice.get_ydata() + 0.02).all()  # type: ignore[operator]
    assert three.get_xdata()[0] == pytest.approx(3e3 * sizing.sigma)  # type: ignore[index]
    assert answer.get_xdata()[0] == pytest.approx(1e3 * sizing.clearance.value)  # type: ignore[index]
    assert math.log(answer.get_ydata()[0]) == pytest.approx(math.log(0.05), abs=0.05)  # type: ignore[index]
    plt.close("all")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "give exactly one of probability, rate, impact_speed, peak_acceleration"),
        (("--probability", "2"), "probability must be in"),
        (("--peak-acceleration", "30 apples"), "number of m/s^2 or of g"),
        (("--peak-acceleration", "30g"), "needs the stiffness of the stops"),
        (("--rate", "1", "--mission", "-1"), "mission must be a positive"),
        (("--probability", "0.1", "--rel-error", "2"), "rel_error must be in"),
    ],
)
def test_bad_input_is_a_sentence(stochvi: Run, arguments: tuple[str, ...], sentence: str) -> None:  # noqa: F811
    done = stochvi("size", ISOLATOR, *arguments)
    assert done.code == 2
    assert sentence in done.err and done.out == ""


def test_chances_are_never_rounded_to_certainty() -> None:
    assert [spoken_percent(p) for p in (0.5, 1e-3, 1e-9, 0.9995)] == [
        "50 %", "0.1 %", "1.0e-07 %", "over 99.9 %",
    ]  # fmt: skip
