"""The report of a sizing: one page that needs nothing else, with the numbers of the sizing."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ConstantLoad,
    FilteredNoise,
    Isolator,
    Restitution,
    RoadNoise,
    WhiteNoise,
    screen,
    size,
)
from stochvi.isolators.record_verdict import RecordVerdict
from stochvi.isolators.screening import environment
from stochvi.isolators.sizing.answer import Sizing, Target
from stochvi.isolators.sizing.review import PeakSettings, Review, ReviewSettings, review
from stochvi.isolators.sizing.sensitivity import worst_case
from stochvi.isolators.tolerances import Tolerances
from stochvi.mathematics.units import ACCELERATION, STANDARD_GRAVITY, shown_in, units_of
from stochvi.results.base import named_with_units
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate, plus_minus, spoken_percent
from stochvi.results.files import Origin, origin_of
from stochvi.scenes.excitations import Excitation
from stochvi.scenes.scene import Scene
from stochvi.views.pages import Fact, Grid, Page, Picture, Section
from stochvi.views.report import write_report
from stochvi.views.report.sections import (
    environment_section,
    gap_section,
    mount_section,
)
from stochvi.views.report.sizing import hard_hits_section, sizing_page
from stochvi.views.sizing import plot_exceedances, plot_input, plot_risk
from stochvi.views.tables import TINY
from support.commands import Run
from support.sized import TRUCK, scene_between_stops, sizing_of

QUICK = ReviewSettings(
    peaks=PeakSettings(stiffness_ratios=(1000.0,), multiples=(3.0, 4.0), seconds=0.1),
    closure_points=9,
    clearances=3,
)

VOID = {"meta", "br", "img", "link", "input", "hr"}


def plain(text: str) -> str:
    return " ".join(text.replace("\u00a0", " ").split())


class Reader(HTMLParser):
    """Tags that are closed in order, what they refer to, and the text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []
        self.identifiers: list[str] = []
        self.text_before: dict[str, str] = {}
        self.text = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.text += " "
        for name, value in attributes:
            if name in ("src", "href", "srcset", "data", "action"):
                self.references.append(value or "")
            if name == "id":
                self.identifiers.append(value or "")
                self.text_before[value or ""] = plain(self.text)
            assert not name.startswith("on"), f"script in {tag}"
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, text: str) -> None:
        if "style" not in self.open:
            self.text += text


def read(html: str) -> Reader:
    reader = Reader()
    reader.feed(html)
    assert reader.open == []
    reader.text = plain(reader.text)
    return reader


@pytest.fixture(scope="module")
def sizing() -> Sizing:
    """With the tolerance of the frequency that the scene states."""
    found = sizing_of(scene_between_stops())
    allowed = Tolerances.of(found.scene)
    table = worst_case(found, allowed, threads=1, budget=10.0)
    return replace(found, allowed=allowed, worst_case=table)


@pytest.fixture(scope="module")
def reviewed(sizing: Sizing) -> Review:
    return review(sizing, settings=QUICK)


@pytest.fixture(scope="module")
def folder(reviewed: Review, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "new"
    assert write_report(reviewed.sizing, folder, review=reviewed) == folder / "report.html"
    return folder


def review_of(
    scene: Scene | None = None, *, noise: Excitation = TRUCK, structure: Isolator | None = None
) -> Review:
    """The review of a scene, by default of one without stops, for which nothing is simulated."""
    options = {} if structure is None else {"structure": structure}
    sizing = sizing_of(scene or scene_between_stops(law=None, noise=noise, **options))
    return review(sizing, settings=ReviewSettings(budget=1e-3))


def page_of(found: Review) -> Page:
    return sizing_page(found.sizing, origin_of(found.sizing.provenance), found)


@pytest.fixture(scope="module")
def html(folder: Path) -> str:
    return (folder / "report.html").read_text("utf-8")


# The page ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_refers_to_nothing_outside_itself(html: str) -> None:
    reader = read(html)
    inside = {f"#{name}" for name in reader.identifiers}
    pictures = [source for source in reader.references if source not in inside]
    assert len(pictures) == reader.tags.count("img") > 7
    assert all(source.startswith("data:image/svg+xml;base64,") for source in pictures)
    assert not {"script", "link", "iframe", "object"} & set(reader.tags)
    assert "url(" not in html and "@import" not in html
    assert not re.findall(r"(?:src|href)\s*=\s*[\"']?\s*(?:https?:)?//", html)


def test_every_picture_is_a_whole_svg_without_references(html: str) -> None:
    for encoded in re.findall(r"data:image/svg\+xml;base64,([^\"]+)", html):
        root = ET.fromstring(base64.b64decode(encoded, validate=True))
        assert root.tag.endswith("}svg")
        for element in root.iter():
            for name, value in element.attrib.items():
                assert not name.endswith("href") or value.startswith("#")


def test_the_same_figure_gives_the_same_bytes(reviewed: Review, html: str) -> None:
    before = plt.get_fignums()
    again = Picture(lambda: plot_input(reviewed), "again")
    assert f'src="{again.uri}"' in html
    assert plt.get_fignums() == before


def test_the_verdict_comes_first_and_every_part_is_there(sizing: Sizing, html: str) -> None:
    reader = read(html)
    assert reader.tags.count("h1") == 1
    assert reader.identifiers == [
        "signatures", "required-clearance", "tolerances", "with-stops", "hard-impacts",
        "peak-accelerations", "linear-screening", "environment", "isolator", "gap-and-stops",
        "verification", "limits", "inputs",
    ]  # fmt: skip
    above = reader.text_before["required-clearance"]
    for words in ("stops at the clearance to make", "One direction of motion", "Approved"):
        assert words in above  # the drawing, what is assumed, and room to sign
    assert sizing.verdict()[1:] in above and sizing.stops_to_copy() in above
    # rms of the profile as stated and as integrated, of the response and the sag of a 12 Hz mount
    for known in ("1.08 g rms", "1.078 g rms", "1.570 mm rms", "1.725 mm"):
        assert known in reader.text, known


def test_numbers_of_the_page_are_those_of_the_sizing(sizing: Sizing, html: str) -> None:
    text = read(html).text
    linear = screen(sizing.scene)
    for number in (
        f"{1e3 * sizing.clearance.value:.4g} mm",
        f"{1e3 * linear.displacement_std:.4g} mm rms",
        f"{linear.velocity_std:.4g} m/s rms",
        f"{linear.acceleration_std / 9.80665:.4g} g rms",
        f"{linear.rice_rate(3.0 * linear.displacement_std):.4g} per second",
        f"{linear.zero_crossing_rate:.4g} Hz",
    ):
        assert number in text, number
    for row in sizing.required.to_dict("records"):
        assert f"{1e3 * row['clearance']:.4g}" in text


NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?: \d{3})*(?:\.\d+)?(?:e[-+]?\d+)?")

IN_WORDS = re.compile(
    r"method 514.8|3 sigma|95 %|over 99.9 %|1 g\b|9\.80665|"
    r"ISO 8608|±3 dB|3 without stops|0 for a right answer|g / ω²"
)
"""Phrases of the page whose numbers are words: no calculation has made them."""


def numbers_of(document: object) -> list[float]:
    """All numbers of a JSON document but those of its curves: also in its texts, and the ends of
    the 95 % intervals that standard errors stand for."""
    if isinstance(document, bool) or document is None:
        return []
    if isinstance(document, int | float):
        return [float(document)]
    if isinstance(document, str):
        return [float(text.replace(" ", "")) for text in NUMBER.findall(document)]
    if isinstance(document, list):
        return [number for part in document for number in numbers_of(part)]
    found = []
    assert isinstance(document, dict)
    for key, part in document.items():
        if key in ("curve", "closure", "spectra", "breakpoints", "faster_hits", "transmissibility"):
            continue
        if key not in ("edges", "density") or not isinstance(part, list):
            found += numbers_of(part)
        if key.endswith("_error") and isinstance(part, float):
            half = 1.959963984540054 * part
            if key == "standard_error":  # all errors of an estimate make one interval
                half = 1.959963984540054 * math.hypot(part, document.get("bias_error", 0.0))
                half += document.get("bias") or 0.0
            value = document.get("value" if key == "standard_error" else key[: -len("_error")], 0.0)
            found += [half, value - half, value + half]
    return found


def separated(html: str) -> str:
    """The text of a page with bars where its elements end."""
    body = html[html.index("<body") :].replace("\u00a0", " ")
    return unescape(re.sub(r"<[^>]*>", " | ", body))


def not_found(text: str, document: dict[str, object]) -> list[str]:
    """Numbers of a text that no number of a document gives when it is written with as many digits,
    in SI units or in thousandths, per cent or g."""
    known = np.array(numbers_of(document))
    known = np.abs(np.concatenate([factor * known for factor in (1.0, 1e3, 100.0, 1.0 / 9.80665)]))
    missing = []
    for number in NUMBER.findall(IN_WORDS.sub("", text)):
        digits = number.replace(" ", "").lstrip("+-")
        mantissa, _, exponent = digits.partition("e")
        half = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        if " " in number or digits == mantissa.rstrip("0") == "":
            half = 0.5 * 10.0 ** max(len(digits) - 3, 0)  # three digits of a count
        if not np.any(np.abs(known - float(digits)) <= half * (1.0 + 1e-9)):
            missing.append(number)
    return missing


def test_every_number_of_the_page_is_in_its_document(folder: Path, html: str) -> None:
    document = json.loads((folder / "size.json").read_text("utf-8"))
    text = separated(html)
    assert len(NUMBER.findall(text)) > 200
    assert not_found(text, document) == []


def test_a_number_that_a_view_makes_up_is_noticed(folder: Path, html: str) -> None:
    """The negative control: what the review adds is missing from a document without it, and of
    numbers with a changed digit, which may by chance stand elsewhere in the document, most are."""
    document = json.loads((folder / "size.json").read_text("utf-8"))
    text = separated(html)
    base = document["review"]["environment"]["base"]["displacement_std"]
    alone = {key: value for key, value in document.items() if key != "review"}
    assert f"{1e3 * base:#.4g}" in not_found(text, alone)
    duration = f"{document['review']['motion']['duration']:.4g}"
    for number in (f"{1e3 * base:.3f}", duration):
        changed = [f"{float(number) * (1.0 + 0.01 * tenth):.4g}" for tenth in range(3, 13)]
        missing = not_found(f"numbers {', '.join(changed)} of nobody", document)
        # each may be among the thousands of the document by chance, about one in ten
        assert len(missing) > len(changed) / 2


def test_peaks_on_the_page_are_those_of_its_table(folder: Path, html: str) -> None:
    table = pd.read_csv(folder / "peaks.csv")
    own = table[table["stiffness_ratio"].isna()]
    assert len(own) == 2 and len(table) == 2 + 2
    text = read(html).text
    for row in own.to_dict("records"):
        value, error = (row[f"largest_acceleration{end}"] for end in ("_m_s2", "_m_s2_error"))
        largest = Estimate(value=value, standard_error=error)
        assert plus_minus(largest, ACCELERATION) in text.replace("\u00a0", " ")
        value, error = (row[f"rms_amplification{end}"] for end in ("", "_error"))
        times = Estimate(value=value, standard_error=error)
        assert plus_minus(times) in text.replace("\u00a0", " ")
    # the impacts hardly show in the rms, and multiply the peak
    assert 1.0 < own["rms_amplification"].iloc[0] < 1.1 < own["peak_amplification"].iloc[0]


@pytest.mark.verify
@pytest.mark.usefixtures("blank_pictures", "short_review")
def test_a_rigid_stop_has_no_table_of_peak_accelerations(folder: Path, tmp_path: Path) -> None:
    sizing = sizing_of(scene_between_stops(Restitution(coefficient=0.5)), paths=64)
    write_report(sizing, tmp_path, review=review(sizing))
    missing = {path.name for path in folder.iterdir()} - {path.name for path in tmp_path.iterdir()}
    # nor are there tolerances, within which the other scene was sized
    assert missing == {"peaks.csv", "tolerances.csv"}
    document = json.loads((tmp_path / "size.json").read_text("utf-8"))
    assert document["review"]["peaks"] is None


@pytest.mark.usefixtures("blank_pictures")
def test_what_the_scene_lacks_is_left_out(tmp_path: Path) -> None:
    bare = review_of(noise=WhiteNoise(density=1e-3, unit="g2/Hz"))
    reader = read(write_report(bare.sizing, tmp_path, review=bare).read_text("utf-8"))
    assert "with-stops" not in reader.identifiers
    assert "White noise on base" in reader.text
    assert not (tmp_path / "evidence.csv").exists()


@pytest.mark.usefixtures("blank_pictures")
def test_warnings_stand_above_the_evidence() -> None:
    """A mount below its profile: the linear response misleads."""
    mount = Isolator(frequency_hz=8.0, zeta=0.1)
    noise = type(TRUCK)(profile="navmat-p-9492")
    page = page_of(review_of(noise=noise, structure=mount))
    notes = screen(scene_between_stops(law=None, noise=noise, structure=mount)).notes
    assert notes and set(notes) <= set(page.warnings)
    above = read(page.html()).text_before["required-clearance"]
    assert all(note in above for note in notes)


def test_words_from_the_scene_are_escaped() -> None:
    page = Page(
        origin=Origin(time="now", version="1", listing="<q>1 m</q>"),
        title="<script>alert(1)</script>",
        subtitle="a & b",
        verdict="x < y",
        cards=[Fact("<b>", "1 %", "")],
        sections=[
            Section(title="S & T", grids=[Grid(caption="<i>", headings=["<u>"], rows=[["<s>"]])]),
            Section(title="Empty"),
        ],
    )
    reader = read(page.html())
    assert not {"script", "b", "i", "u", "s"} & set(reader.tags)
    assert "<script>alert(1)</script>" in reader.text
    assert reader.identifiers == ["s---t", "inputs", "signatures"]
    assert "<q>1 m</q>" in reader.text


def test_tables_and_numbers_lie_beside_the_page(sizing: Sizing, folder: Path) -> None:
    document = json.loads((folder / "size.json").read_text("utf-8"))
    assert document["clearance"]["value"] == sizing.clearance.value
    for name, table in (("risk", sizing.curve), ("required", sizing.required)):
        found = pd.read_csv(folder / f"{name}.csv")
        pd.testing.assert_frame_equal(found, named_with_units(table), check_exact=True)
        assert "clearance_m" in found and not any(" " in column for column in found)
    assert set(pd.read_csv(folder / "evidence.csv")["at"]) == {"three_sigma", "recommended"}
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "report.html", "size.json", "risk.csv", "required.csv", "hits.csv",
        "risk.png", "tolerances.csv", "exceedances.csv", "evidence.csv", "peaks.csv",
    }  # fmt: skip


def test_a_browser_shows_it_wide_and_narrow_without_a_network(folder: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("no chromium here")
    # both widths side by side: most of the time is the start of the browser
    target, both, widths = tmp_path / "page.png", tmp_path / "both.html", (1280, 400)
    frames = "".join(
        f'<iframe src="{(folder / "report.html").as_uri()}" width="{width}" height="900"></iframe>'
        for width in widths
    )
    style = "<style>body { margin: 0; display: flex } iframe { border: 0 }</style>"
    both.write_text(f"<!doctype html>{style}{frames}", encoding="utf-8")
    run = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-quic",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}",
        f"--window-size={sum(widths)},900", f"--screenshot={target}", both.as_uri(),
    ]  # fmt: skip
    subprocess.run(run, check=True, capture_output=True, timeout=600)
    from matplotlib.image import imread

    picture = imread(target)[..., :3]
    assert picture.shape[:2] == (900, sum(widths))
    for view in np.split(picture, [widths[0]], axis=1):
        # ink, colour and paper: a page that failed to load is a plain sheet or a plain message
        spread = view.max(axis=-1) - view.min(axis=-1)
        assert 0.005 < float((view.mean(axis=-1) < 0.5).mean()) < 0.5
        assert float((spread > 0.3).mean()) > 0.001


# What it says of the inputs ---------------------------------------------------------------


def facts(section: Section) -> dict[str, tuple[str, str]]:
    return {fact.name: (fact.value, fact.remark) for fact in section.facts}


@pytest.mark.usefixtures("blank_pictures")
def test_the_base_moves_as_its_density_says() -> None:
    """G = a f^2 from a road: velocity white, displacement falling as f^-2; all by hand."""
    low, high, speed = 0.5, 40.0, 20.0
    road = RoadNoise(road="B", speed=speed, band_hz=[low, high])
    told = facts(environment_section(review_of(noise=road)))
    white = (2.0 * math.pi * 0.1) ** 2 * 64e-6 * speed
    assert told["Base velocity"][0] == f"{math.sqrt(white * (high - low)):.4g} m/s rms"
    shift = white / (2.0 * math.pi) ** 2 * (1.0 / low - 1.0 / high)
    assert told["Base displacement"][0] == f"{1e3 * math.sqrt(shift):.4g} mm rms"
    pull = white * (2.0 * math.pi) ** 2 * (high**3 - low**3) / 3.0
    recomputed = told["Base acceleration, recomputed"][0]
    assert recomputed == f"{math.sqrt(pull) / 9.80665:.4g} g rms"


def test_sag_moves_the_stops_and_is_told(sizing: Sizing, reviewed: Review) -> None:
    section = gap_section(reviewed)
    assert "static equilibrium is at -1.725 mm" in section.lead
    told = facts(section)
    assert sizing.worst_case is not None
    made = math.ceil(1e4 * sizing.worst_case["clearance"].iloc[-1]) / 10.0
    lower = -sizing.scene.structure.sag - 1e-3 * made
    value, remark = told["Clearance of the lower stop, to make"]
    assert value == f"{made:.1f} mm"
    # rounded outwards, to a micrometre
    assert f"lower = {math.floor(1e6 * lower) / 1e6:.9g} (m)" in remark
    value, remark = told["Clearance of the lower stop of the scene"]
    assert value == "7.275 mm" and "lower = -0.009 (m); viscoelastic" in remark
    plain = Isolator(frequency_hz=12.0, zeta=0.1)
    _, remark = facts(mount_section(review_of(structure=plain)))["Static sag under 1 g"]
    assert "for information" in remark


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("late", [True, False])
def test_equal_digits_are_promised_unless_the_clock_decided(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, sizing: Sizing, reviewed: Review, late: bool
) -> None:
    def answered(*_: object) -> Sizing:
        assert Deadline.after(-1.0 if late else 60.0).passed() is late
        return sizing

    monkeypatch.setattr(sys.modules["stochvi.isolators.sizing.size"], "_answered", answered)
    found = size(sizing.scene, probability=0.01)
    assert any("another run may give other last digits" in each for each in found.warnings) is late
    page = write_report(found, tmp_path, review=replace(reviewed, sizing=found))
    told = read(page.read_text("utf-8")).text
    assert ("give the same digits" in told) is not late
    assert ("the budget ended a part of the calculation, so that another run" in told) is late


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"damping": 97.0}, "35000 N/m and 97 N s/m each"),
        ({"zeta": 0.12}, "35000 N/m and zeta 0.12 each"),
        ({"Q": 4.0}, "35000 N/m and Q 4 each"),
        ({"loss_factor": 0.24}, "35000 N/m and loss factor 0.24 each"),
    ],
)
def test_mounts_are_told_by_the_keys_that_state_them(keys: dict[str, float], words: str) -> None:
    mount = Isolator(mass=35.0, mounts=6, stiffness=35e3, **keys)
    value, remark = facts(mount_section(review_of(structure=mount)))["Mounts side by side"]
    assert (value, remark) == ("6", words)


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize(("contradicts", "judged"), [(True, True), (False, False), (False, True)])
def test_a_record_that_does_not_agree_has_the_first_card(
    reviewed: Review, contradicts: bool, judged: bool
) -> None:
    record = RecordVerdict(
        contradicts=contradicts, judged=judged, reasons=("its peak",) if contradicts else (),
        displacement_max=8e-3, displacement_std=1e-3, peak_in_sigma=8.0,
        expected_peak_in_sigma=3.5, kurtosis=6.0, kurtosis_error=0.2, clearance=8.1004e-3,
        clearance_lower=8.1004e-3, clearance_upper=6.2e-3,
        p_values={"peak": 0.0, "kurtosis": 0.0 if judged else None}, crossings=(), clipped=False,
        lost_share=0.0, level_ratio=None,
    )  # fmt: skip
    sizing = replace(reviewed.sizing, record=record)
    page = page_of(replace(reviewed, sizing=sizing))
    doubtful = contradicts or not judged
    names = [card.name for card in page.cards]
    assert names.index("The record itself needs") == (0 if doubtful else 2)
    assert page.alarm == doubtful
    alarm = "Do not size by the spectrum: this record is "
    assert page.verdict.startswith(alarm) == doubtful
    assert page.html().count(alarm) == doubtful
    # the picture marks what the record needs, and recommends nothing that it contradicts
    ax = plot_risk(sizing)
    labels = " ".join(ax.get_legend_handles_labels()[1])
    assert ("calculated" in labels) != doubtful
    assert (f"make {sizing.widest}" in labels) != doubtful
    # one number in words, on the card and in the picture, rounded upward
    assert ("the record itself: 8.101 mm" in labels) == doubtful
    assert page.cards[names.index("The record itself needs")].value == "8.101 mm"
    assert record.needs() == ("the record itself needs 8.101 mm below and 6.200 mm above")
    one_sided = replace(record, clearance_upper=None)
    assert one_sided.needs() == "the record itself needs 8.101 mm to its stop"
    assert not doubtful or ax.get_xlim()[1] > 8.1
    plt.close(ax.get_figure())


@pytest.mark.usefixtures("blank_pictures")
def test_cards_tell_the_limit_that_is_kept(reviewed: Review) -> None:
    target = Target(
        name="peak_acceleration", value=30.0 * STANDARD_GRAVITY, unit="m/s^2", exceedance=0.01
    )
    sizing = replace(reviewed.sizing, target=target)
    found = replace(reviewed, sizing=sizing)
    cards = {card.name: card for card in page_of(found).cards}
    assert cards["Probability of exceeding 30 g in 1 h"].value == "1 %"
    kept = replace(sizing, kept_with=Estimate(value=0.0, upper_95=1e-3))
    page = page_of(replace(reviewed, sizing=kept))
    cards = {card.name: card for card in page.cards}
    assert cards["Probability of exceeding 30 g in 1 h"].value == "below 1 %"
    doubtful = replace(sizing, kept_with=Estimate(value=0.0, upper_95=0.1))
    unknown = page_of(replace(reviewed, sizing=doubtful))
    risk = {card.name: card for card in unknown.cards}
    assert risk["Probability of exceeding 30 g in 1 h"].value == "not known well enough"
    assert "not shown to keep the target" in risk["Clearance to make"].remark
    assert "was shown to keep the target" in unknown.verdict
    assert "enough, and less may be" in cards["Clearance to make"].remark
    assert "95 %" not in cards["Calculated as stated"].remark
    assert "95 % limit of the probability: 0.1 %" in " ".join(page.sections[0].notes)
    assert "; less may be enough. A peak acceleration above 30 g in 1 h: less than" in page.verdict


def test_hard_impacts_are_told_in_the_unit_of_their_hardness(reviewed: Review) -> None:
    assert reviewed.exceedances is not None
    table = reviewed.exceedances.assign(event="impact_energy", limit=5.0, mark=True)
    found = replace(reviewed, exceedances=table)
    section = hard_hits_section(found)
    assert "the impact energy of any impact" in section.lead and "above 5 J" in repr(section.grids)
    with shown_in(units_of("mJ")):
        ax = plot_exceedances(found)
    assert "above 5e+03 mJ" in ax.get_legend_handles_labels()[1]
    plt.close(ax.get_figure())


@pytest.mark.usefixtures("blank_pictures")
def test_stops_far_beyond_the_curve_have_a_limit_of_their_chance(
    sizing: Sizing, reviewed: Review
) -> None:
    sag = sizing.scene.structure.sag
    far = sizing.scene.impact_pairs[0].model_copy(update={"lower": -1.0 - sag, "upper": 1.0 - sag})
    scene = sizing.scene.model_copy(update={"impact_pairs": (far,)})
    moved = replace(sizing, scene=scene, probability_of_stops=None)
    limit = f"under {spoken_percent(TINY)}"
    told = facts(gap_section(replace(reviewed, sizing=moved)))["Stops of the scene"]
    assert told[0] == f"{limit} likely to be hit"


@pytest.mark.usefixtures("blank_pictures")
def test_filtered_noise_on_a_base_is_told_before_its_resonance() -> None:
    noise = FilteredNoise(density=2.0, unit="(m/s2)2/Hz", frequency_hz=8.0, zeta=0.2)
    scene = scene_between_stops(law=None, noise=noise)
    plain = review_of()  # the screening of a sizing does not cover filtered noise
    shaken = replace(
        plain, sizing=replace(plain.sizing, scene=scene), environment=environment(scene)
    )
    section = environment_section(shaken)
    value, remark = facts(section)["Filtered noise on base"]
    assert value == "2 (m/s²)²/Hz"
    assert "before the filter, a resonance at 8 Hz with a damping ratio of 0.2" in remark


@pytest.mark.usefixtures("blank_pictures")
def test_other_excitations_are_told_with_their_units() -> None:
    scene = scene_between_stops(law=None)
    more = scene.model_copy(update={"excitations": (*scene.excitations, ConstantLoad(force=-3.0))})
    assert facts(environment_section(review_of(more)))["Constant load on x"][0] == "-3 N"


# ------------------------------------------------------------------------------
# Pages of reliabilities and replays: verdict first, then the numbers and where they come from.
# ------------------------------------------------------------------------------


MOUNT = """
title = "a box"
[structure]
kind = "isolator"
mass = 2.0
frequency_hz = 12.0
Q = 5.0
[[impact_pair]]
clearance = 0.002
law = { kind = "restitution", coefficient = 0.5 }
[[excitation]]
"""


def page_in(folder: Path) -> str:
    return (folder / "report.html").read_text("utf-8").replace("\u00a0", " ")


@pytest.mark.usefixtures("blank_pictures")
def test_a_replay_has_a_page_that_names_its_record(stochvi: Run, tmp_path: Path) -> None:
    scene, record = tmp_path / "box.toml", tmp_path / "record.csv"
    lines = [f"{n / 500:.3f},{9.0 * math.sin(75.0 * n / 500):.5f}" for n in range(1500)]
    record.write_text("time (s),a (m/s2)\n" + "\n".join(lines) + "\n")
    scene.write_text(MOUNT + 'kind = "record"\nfile = "record.csv"\nunit = "m/s2"\n')
    out = tmp_path / "out"
    assert stochvi("replay", scene, "--out", out, "--quiet").code == 0
    text, document = page_in(out), json.loads((out / "replay.json").read_text("utf-8"))
    for file in (scene, record):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    pair = document["impact_pairs"]["stops"]
    assert pair["hits"]["value"] > 5.0
    assert f"{pair['hits']['value']:.0f} impacts on stops" in text
    assert (
        text.index("impacts on stops") < text.index("Motion and impacts") < text.index("Approved")
    )
    for field in ("Customer", "Laboratory", "Project", "Report no.", "Date"):
        assert f">{field}</th>" in text
    assert 'class="verdict alarm"' in text  # it touches its stops
    assert "Clearance of &#39;stops&#39;, lower" in text and "2.000 mm" in text
    assert "Natural frequency" in text and "damping ratio 0.1" in text
    # the same question may be asked again, another one not
    assert stochvi("replay", scene, "--out", out, "--quiet").code == 0
    asked = ("replay", scene, "--clearances", "1mm,3mm", "--out", out, "--quiet")
    assert stochvi(*asked).code == 2
    assert stochvi(*asked, "--force").code == 0
    text = page_in(out)
    assert "at 1.000 mm" in text and "at 3.000 mm" in text
    # farther than the motion reaches there is no impact, and no alarm
    far = ("replay", scene, "--clearances", "30mm", "--out", out, "--quiet", "--force")
    assert stochvi(*far).code == 0
    quiet = page_in(out)
    assert "no impact on stops" in quiet or "impacts 0 at 30 mm" in quiet
    assert 'class="verdict alarm"' not in quiet and "largest impact speed (m/s)" not in quiet
    # what the record needs comes first, then the impacts at each clearance
    assert (
        text.index("The record itself needs") < text.index(": impacts ") < text.index("Motion and")
    )


@pytest.mark.usefixtures("blank_pictures")
def test_a_reliability_has_a_page_with_its_chances(stochvi: Run, tmp_path: Path) -> None:
    scene = tmp_path / "box.toml"
    scene.write_text(MOUNT + 'kind = "white"\ndensity = 0.002\nunit = "g2/Hz"\n')
    out = tmp_path / "out"
    done = stochvi(
        "reliability", scene, "--mission", "60", "--impact-speed", "0.1", "--rel-error", "0.2",
        "--threads", "1", "--budget", "10", "--out", out, "--quiet",
    )  # fmt: skip
    assert done.code in (0, 1)
    text, document = page_in(out), json.loads((out / "reliability.json").read_text("utf-8"))
    assert document["report"]["command"].startswith("stochvi reliability")
    for name, words in (("hit", "An impact"), ("impact_speed", "An impact faster than 0.1 m/s")):
        chance = document["chances"][name]["estimate"]["value"]
        assert chance > 0.0
        assert f"{words} in 1 min: " in text[text.index('class="verdict') : text.index("<dl")]
    assert "Expected impacts in 1 min" in text


@pytest.mark.parametrize("command", ["replay", "reliability"])
def test_a_page_that_is_not_ours_is_kept(stochvi: Run, tmp_path: Path, command: str) -> None:
    scene = tmp_path / "box.toml"
    scene.write_text(MOUNT + 'kind = "white"\ndensity = 0.002\nunit = "g2/Hz"\n')
    (tmp_path / "report.html").write_text("mine")
    mission = ("--mission", "60") if command == "reliability" else ()
    done = stochvi(command, scene, *mission, "--out", tmp_path)
    assert done.code == 2 and "--force" in done.err
    assert (tmp_path / "report.html").read_text() == "mine"
