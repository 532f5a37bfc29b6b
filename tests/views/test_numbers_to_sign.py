"""The number that a page shows largest is the one to sign: of every kind of answer that has a page,
with a record that contradicts, several pairs, phases, and a budget that was spent."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest

from stochvi import (
    ImpactPair,
    Isolator,
    NotApplicable,
    Restitution,
    Scene,
    load_scene,
    reliability,
    size,
)
from stochvi import replay as replayed
from stochvi.isolators.record_verdict import RecordVerdict, record_verdict
from stochvi.isolators.screening import scene_at_rest
from stochvi.isolators.sizing import pairs as pairs_module
from stochvi.isolators.sizing import search
from stochvi.isolators.sizing.answer import Clearance, ClearanceAnswer, DamageSizing, Sizing, Target
from stochvi.isolators.sizing.review import PeakSettings, ReviewSettings, review
from stochvi.isolators.tolerances import Tolerances
from stochvi.results.estimates import Cost, Estimate, capital
from stochvi.results.files import origin_of
from stochvi.scenes.datasets import shipped_scene
from stochvi.views.isolator_tables import damage_ratio_told, sizing_told
from stochvi.views.pages import Page, Picture
from stochvi.views.report import missions, sections, sizing
from stochvi.views.tables import to_copy
from support.pairs import pair, uncoupled
from support.sized import scene_between_stops, sizing_of

NEEDS = 18.9496e-3
"""Clearance that the record of these tests needs, m: far beyond every sized one."""


def verdict(kind: str, clearance: float = NEEDS, gap: str | None = None) -> RecordVerdict:
    """A record that "contradicts", is too "short" to be judged, or "agrees"."""
    return RecordVerdict(
        contradicts=kind == "contradicts", judged=kind != "short", reasons=("its peak",),
        displacement_max=clearance, displacement_std=1e-3, peak_in_sigma=8.0,
        expected_peak_in_sigma=3.5, kurtosis=6.0, kurtosis_error=0.2, clearance=clearance,
        clearance_lower=clearance, clearance_upper=0.8 * clearance,
        p_values={"peak": 0.0, "kurtosis": 0.0}, crossings=(), clipped=False, lost_share=0.0,
        level_ratio=None, gap=gap,
    )  # fmt: skip


class Cards(HTMLParser):
    """The cards of a page by their names, as the text of each class, and the sizes of the letters
    of these classes in the style of the page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.cards: list[dict[str, str]] = []
        self.sizes: dict[str, float] = {"": 1.0}
        self._inside, self._class, self._style = False, "", False
        self.feed(html)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        named = dict(attributes).get("class") or ""
        self._style = tag == "style"
        self._inside = (self._inside or (tag == "dl" and named == "cards")) and tag != "section"
        if self._inside and tag == "div":
            self.cards.append({})
        self._class = (named or tag) if tag in ("dt", "dd") else ""

    def handle_endtag(self, tag: str) -> None:
        self._inside = self._inside and tag != "dl"
        self._class, self._style = "", self._style and tag != "style"

    def handle_data(self, text: str) -> None:
        if self._style:
            found = re.findall(r"\.cards \.?(\w+) \{[^}]*font-size: ([\d.]+)rem", text)
            self.sizes |= {name: float(size) for name, size in found}
        elif self._inside and self._class:
            before = self.cards[-1].get(self._class, "")
            self.cards[-1][self._class] = before + text.replace("\u00a0", " ")

    @property
    def largest(self) -> str:
        """The text in the largest letters that stands first."""
        assert {"dt", "value", "remark"} <= set(self.sizes)
        return self.cards[0][max(self.sizes, key=lambda name: self.sizes[name])]

    def lengths(self) -> dict[str, float]:
        """The lengths in the largest letters by the names of their cards, m."""
        name = max(self.sizes, key=lambda each: self.sizes[each])
        return {each["dt"]: length(each[name]) for each in self.cards if " mm" in each[name]}


def length(text: str) -> float:
    return 1e-3 * float(text.removesuffix(" mm").rpartition(" ")[2])


def up(value: float) -> float:
    """A clearance rounded up: to 0.1 mm, or to a finer step of at most 5 % of it."""
    step = 1e-4
    while step > 0.05 * value:
        step /= 10.0
    return step * math.ceil(value / step - 1e-6)


def to_sign(
    found: Mapping[str, float], verdicts: list[RecordVerdict], kept: bool = True
) -> float | None:
    """The number to sign, m: what the record needs where it does not agree with the noise, else the
    largest clearance, rounded up; None where none keeps the target."""
    gaps = [gap for each in verdicts for gap in (each, *each.others.values())]
    if any(not each.agrees for each in gaps):
        return 1e-6 * math.ceil(1e6 * max(each.clearance for each in gaps))
    return max(map(up, found.values())) if kept else None


Drawn = list[tuple[ImpactPair, ...]]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Drawn:
    """The pairs of each drawing of stops; no picture is drawn."""
    seen: Drawn = []

    def shown(draw: Any, caption: str, **_: Any) -> Picture:
        if re.search(r"\b[Ss]tops (as|at) ", caption):
            draw()
        return Picture(draw=draw, caption=caption)

    monkeypatch.setattr(Picture, "uri", "")

    for module in (missions, sections, sizing):
        monkeypatch.setattr(module, "Picture", shown)
    monkeypatch.setattr(sections, "draw_problem", lambda scene, *_: seen.append(scene.impact_pairs))
    monkeypatch.setattr(sections, "draw_gaps", lambda stops, _: seen.append(tuple(stops)))
    return seen


def judge(page: Page, found: ClearanceAnswer, sign: float | None, drawn: Drawn) -> None:
    """Hold the largest number of a page to the number to sign, and the drawing and the document to
    what is to be made."""
    cards = Cards(page.html())
    made = found.to_dict()["made"]
    doubtful = any(not each.agrees for each in verdicts_of(found))
    if sign is None:
        assert cards.largest == "not known" and made is None
    else:
        assert length(cards.largest) == pytest.approx(sign, rel=1e-9)
        assert max(cards.lengths().values()) == pytest.approx(sign, rel=1e-9)
    if doubtful:
        assert made is None and not any("to make" in name for name in cards.lengths())
    elif sign is not None:
        each = [made] if "value" in made else list(made.values())
        assert max(one["value"] for one in each) == pytest.approx(sign, rel=1e-9)
    rests = found.rests
    for stops in drawn:
        for own in stops:
            stated = next(each for each in found.scene.impact_pairs if each.name == own.name)
            place = (own.upper or 0.0) - rests[own.name]
            if made is None:
                assert (own.lower, own.upper) == (stated.lower, stated.upper)
            else:
                value = (made if "value" in made else made[own.name])["value"]
                assert place == pytest.approx(value, rel=1e-4)


def verdicts_of(found: ClearanceAnswer) -> list[RecordVerdict]:
    if isinstance(found, Sizing) and found.scene.phases:
        return list(found.records.values())
    return [] if found.record is None else [found.record]


@pytest.fixture(scope="module")
def one() -> Sizing:
    scene = scene_between_stops(law=None)
    stops = ImpactPair(lower=-9e-3, upper=5e-3, law=Restitution(coefficient=0.5))
    return replace(sizing_of(scene), scene=scene.replace(impact_pairs=[stops]))


def page_of_one(found: Sizing) -> Page:
    settings = ReviewSettings(
        peaks=PeakSettings(stiffness_ratios=(), multiples=(3.0,), seconds=0.01), closure_points=2,
        clearances=1,
    )  # fmt: skip
    simulated = ("motion_between_stops", "_exceedances", "_exceeding", "peak_accelerations")
    with contextlib.ExitStack() as left_out:
        for name in simulated:
            place = f"stochvi.isolators.sizing.review.{name}"
            empty = {} if name == "_exceeding" else None
            left_out.enter_context(mock.patch(place, return_value=empty))
        reviewed = review(found, settings=settings, threads=1)
    return sizing.sizing_page(found, origin_of(found.provenance), reviewed)


@pytest.mark.parametrize("kind", ["", "agrees", "contradicts", "short", "worst", "spent"])
def test_the_page_of_one_mass_shows_the_number_to_sign(
    one: Sizing, drawn: Drawn, kind: str
) -> None:
    found, needed = one, one.clearance.value
    if kind in ("agrees", "contradicts", "short"):
        found = replace(one, record=verdict(kind, 8e-3 if kind == "agrees" else NEEDS))
    if kind == "worst":
        needed *= 1.3
        rows = [("none", one.clearance.value, 0.0), ("all", needed, 0.3)]
        table = pd.DataFrame(rows, columns=["change", "clearance", "clearance_change"])
        table = table.assign(probability=0.02, note="", sigma=one.sigma)
        found = replace(one, allowed=Tolerances(frequency=0.1), worst_case=table)
    if kind == "spent":
        target = Target(name="peak_acceleration", value=300.0, unit="m/s^2", exceedance=0.01)
        found = replace(one, target=target, kept_with=Estimate(value=0.0, upper_95=0.3))
    sign = to_sign({"stops": needed}, verdicts_of(found), kept=kind != "spent")
    page = page_of_one(found)
    if kind == "spent":  # 3 sigma is the only length left, and no card says to make it
        assert Cards(page.html()).largest == "not known"
        assert found.made is None and found.to_dict()["made"] is None
        assert found.stops_to_copy() == ""
        return
    judge(page, found, sign, drawn)
    assert drawn


@pytest.fixture(scope="module")
def phases() -> Sizing:
    scene = Scene(
        structure=Isolator(frequency_hz=12.0, zeta=0.1, gravity=True),
        impact_pairs=[ImpactPair(clearance=0.0135, law=Restitution(coefficient=0.7))],
        excitations=[{"kind": "psd", "profile": "mil-std-810h-truck-vertical-5hz"}],
        phase=[
            {"name": "air", "duration": 36000.0, "level_db": -6.0},
            {"name": "road", "duration": 30.0},
        ],
    )
    found = size(scene, probability=0.05, rel_error=0.3, threads=1)
    assert found.scene.phases
    return found


@pytest.mark.parametrize(
    "kinds", [(), ("agrees", "agrees"), ("agrees", "contradicts"), ("short", "agrees")]
)
def test_the_page_of_a_mission_shows_the_number_to_sign(
    phases: Sizing, drawn: Drawn, kinds: tuple[str, ...]
) -> None:
    places = [7e-3 if each == "agrees" else NEEDS for each in kinds]
    records = {
        name: verdict(kind, place)
        for name, kind, place in zip(("air", "road"), kinds, places, strict=False)
    }
    found = replace(phases, records=records)
    sign = to_sign({"stops": found.clearance.value}, list(records.values()))
    page = missions.phases_page(found, origin_of(found.provenance))
    judge(page, found, sign, drawn)
    assert len(drawn) == 1
    document = found.to_dict()
    assert set(document["records"]) == set(records)
    if kinds:
        assert document["record"]["contradicts"] == ("contradicts" in kinds)
    else:
        assert document["record"] is None


def test_the_risk_that_a_sentence_keeps_is_that_of_the_number_in_it(phases: Sizing) -> None:
    """Rounded up, a clearance keeps less than the target, and no sentence says otherwise."""
    sentence, made = phases.verdict(), phases.widest
    assert made is not None and sentence.startswith(f"Make {made} on each side of ")
    curve = phases.curve
    risk = math.exp(np.interp(made.value, curve["clearance"], np.log(curve["probability"])))
    assert risk < 0.05
    assert "An impact in 10.01 h: less than 5 % likely" in sentence
    just = re.search(r"\(5 % at ([\d.]+) mm", sentence)
    assert just is not None and float(just[1]) < 1e3 * made.value


@pytest.mark.parametrize("kind", ["", "contradicts"])
def test_the_page_of_a_damage_shows_the_number_to_sign(
    one: Sizing, drawn: Drawn, kind: str
) -> None:
    spectra = SimpleNamespace(equipment_frequency_hz=np.array([100.0]), quality=10.0, exponent=6.0)
    row = {"clearance": 11.2e-3, "damage_ratio": 2.0, "standard_error": 0.1, "frequency_hz": 100.0}
    found = DamageSizing(
        scene=one.scene, ratio=2.0, mission=3600.0, sigma=one.sigma,
        clearances={"stops": Clearance(value=11.23e-3, lower=11e-3, upper=11.4e-3)},
        tried=pd.DataFrame([row | {"by": "clusters"}]), damage=spectra,  # type: ignore[arg-type]
        record=verdict(kind) if kind else None, cost=Cost(wall_time=1.0), provenance={},
    )  # fmt: skip
    page = missions.damage_page(found, origin_of(one.provenance))
    cards = Cards(page.html())
    sign = to_sign({"stops": 11.23e-3}, verdicts_of(found))
    assert length(cards.largest) == pytest.approx(sign, rel=1e-9)
    assert found.verdict().startswith("Do not size by the spectrum") == bool(kind)
    assert (found.made is None) == bool(kind)
    assert any("to make" in name for name in cards.lengths()) != bool(kind)
    (stops,) = drawn
    gap = (stops[0].upper or 0.0) - found.rests["stops"]
    assert gap == pytest.approx(5e-3 - found.rests["stops"] if kind else 11.3e-3, rel=1e-4)


@pytest.mark.parametrize("kind", ["phases", "damage"])
def test_a_page_of_many_pairs_lists_where_each_stop_goes(
    phases: Sizing, drawn: Drawn, kind: str
) -> None:
    """Two pairs round to the same clearance; sentence and cards name that with the larger one."""
    stops = [pair(name, name[0], 4.0) for name in ("x near", "x far", "x too", "z", "z too")]
    values = (3e-3, 16.06e-3, 16.02e-3, 9e-3, 8e-3)
    page_of: Any = missions.phases_page
    told_of: Any = sizing_told
    found: ClearanceAnswer = replace(
        phases,
        scene=uncoupled(*stops).replace(phases=phases.scene.phases),
        clearances={
            each.name: Clearance(value=value, lower=value, upper=value)
            for each, value in zip(stops, values, strict=True)
        },
    )
    if kind == "damage":
        page_of, told_of = missions.damage_page, damage_ratio_told
        row = {"clearance": 16e-3, "damage_ratio": 2.0, "standard_error": 0.1, "by": "clusters"}
        found = DamageSizing(
            scene=found.scene.replace(phases=[]), ratio=2.0, mission=3600.0, sigma=1.0,
            clearances=found.clearances,
            tried=pd.DataFrame([row | {"frequency_hz": 100.0}]), cost=Cost(wall_time=1.0),
            damage=SimpleNamespace(  # type: ignore[arg-type]
                equipment_frequency_hz=np.array([100.0]), quality=10.0, exponent=6.0
            ),
            provenance=phases.provenance,
        )  # fmt: skip
    assert "from 3.0 mm at x near to 16.1 mm at x far, each of 5 pairs" in found.verdict()
    assert "at 16.06 mm for x far" in found.verdict()
    assert to_copy(found) == [
        "Copy into the scene file: the stops of 5 pairs, as the table of -v and of the page "
        "lists them"
    ]
    page = page_of(found, origin_of(found.provenance))
    cards = Cards(page.html())
    assert [*cards.lengths()] == [f"Clearance of {name} to make" for name in ("x near", "x far")]
    (told,) = [each for each in told_of(found).sections if each.grids]
    places = told.grids[0]
    assert [(row[0], row[1], row[-1]) for row in places.rows] == [
        ("x near", "3.0 mm", "0.003"), ("x far", "16.1 mm", "0.0161"),
        ("x too", "16.1 mm", "0.0161"), ("z", "9.0 mm", "0.009"), ("z too", "8.0 mm", "0.008"),
    ]  # fmt: skip
    assert capital(places.caption) in page.html()
    assert [each.upper for each in drawn[0]] == [0.003, 0.0161, 0.0161, 0.009, 0.008]


def no_hits(*_: object, **__: object) -> None:
    raise NotApplicable("hits", ["they are left out here"])


@pytest.fixture(scope="module")
def several() -> Sizing:
    with mock.patch.object(search, "count_impacts", no_hits), mock.patch.object(
        pairs_module, "tolerance_table", return_value=(pd.DataFrame(), {})
    ):  # fmt: skip
        scene = uncoupled(pair("x", "x", 4.0), pair("z", "z", 4.0))
        found = size(scene, probability=0.05, mission=1000.0, rel_error=0.3, threads=1)
    assert isinstance(found, Sizing)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["", "contradicts", "wider", "spent"])
def test_the_page_of_several_pairs_shows_the_number_to_sign(
    several: Sizing, drawn: Drawn, kind: str
) -> None:
    """Also where the pair that needs most within the tolerances is not the widest as stated."""
    needed = {name: each.value for name, each in several.clearances.items()}
    found = replace(several, tolerances=pd.DataFrame([{"change": "as stated"}]))
    if kind == "contradicts":
        other = verdict(kind, 9.4321, gap="z")
        found = replace(found, record=replace(verdict(kind, 8.1, gap="x"), others={"z": other}))
    if kind == "wider":
        needed["x"] = 1.4 * max(needed.values())
        rows = [needed | {"change": each, "probability": 0.05} for each in ("as stated", "all")]
        found = replace(found, tolerances=pd.DataFrame(rows), allowed=Tolerances(frequency=0.1))
    if kind == "spent":
        target = Target(name="impact_speed", value=1.0, unit="m/s", exceedance=0.01)
        found = replace(found, target=target, kept_with=Estimate(value=0.0, upper_95=0.3))
    sign = to_sign(needed, verdicts_of(found), kept=kind != "spent")
    page = sizing.sizing_page(found, origin_of(found.provenance))
    cards = Cards(page.html())
    if sign is None:
        assert cards.largest == "not known" and found.to_dict()["made"] is None
    else:
        assert max(cards.lengths().values()) == pytest.approx(sign, rel=1e-9)
    assert any("to make" in each for each in cards.lengths()) == (kind in ("", "wider"))
    (stops,) = drawn
    for own in stops:
        place = found.each_made[own.name].value if found.each_made else 4.0
        assert own.upper == pytest.approx(place, rel=1e-4)


def record_of(folder: Path, scene: Scene, shocks: float) -> Scene:
    """A scene under a record of 4 s along z, with a shock in it."""
    rng, fs = np.random.default_rng(3), 400.0
    t = np.arange(int(4.0 * fs)) / fs
    a = 3.0 * rng.normal(size=t.size)
    a[(t > 2.0) & (t < 2.05)] += shocks
    np.savetxt(folder / "record.csv", np.column_stack([t, a]), delimiter=",")
    record = {"kind": "record", "file": str(folder / "record.csv"), "unit": "m/s2"}
    axis = {} if isinstance(scene.structure, Isolator) else {"axis": "z"}
    return scene.replace(excitations=[record | axis])


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize("shocks", [0.0, 60.0])
def test_the_page_of_the_replay_of_a_box_shows_the_number_to_sign(
    tmp_path: Path, shocks: float
) -> None:
    """The largest gap, whichever pair it is of; and angles and their accelerations in units of
    angles."""
    scene = record_of(tmp_path, load_scene(shipped_scene("rigid-box")), shocks)
    found, record = replayed(scene), record_verdict(scene)
    assert record is not None and record.others
    page = missions.replay_page(found, scene, scene_at_rest(scene), record, origin_of({}))
    cards = Cards(page.html())
    every = (record, *record.others.values())
    sign = 1e-6 * math.ceil(1e6 * max(each.clearance for each in every))
    assert length(cards.largest) == pytest.approx(sign, rel=1e-9)
    moved = {each["dt"]: each["value"] for each in cards.cards}
    rows = {row[0]: row[1] for row in page.sections[0].grids[0].rows}
    for name in ("rx", "ry", "rz"):
        each = found.coordinates[name]
        ends = moved[f"Motion of {name}"].removesuffix(" mrad").split(" to ")
        exact = [1e3 * float(each.displacement_min), 1e3 * float(each.displacement_max)]
        assert [float(end) for end in ends] == pytest.approx(exact, rel=1e-3)
        assert f"{name} from {' to '.join(ends)} mrad" in found.summary()
        own = rows[f"{name}: largest absolute acceleration (rad/s^2)"]
        assert float(own) == pytest.approx(float(each.acceleration_max), rel=1e-3)
    for name in ("x", "y", "z"):
        assert moved[f"Motion of {name}"].endswith(" mm")
        assert f"{name}: largest absolute acceleration (g)" in rows


def test_the_page_of_a_risk_says_for_which_noise_it_holds(phases: Sizing, drawn: Drawn) -> None:
    """What the record needs comes first where it contradicts; no card states a risk without saying
    for what."""
    scene = phases.scene
    found = reliability(scene, rel_error=0.5, threads=1)
    rest = scene_at_rest(scene.phases[0].of(scene))
    for record in (None, verdict("contradicts")):
        page = missions.reliability_page(found, scene, rest, record, origin_of({}))
        cards = Cards(page.html())
        told = next(each for each in cards.cards if each["dt"].startswith("Probability"))
        assert ("for Gaussian noise alone" in told["remark"]) == (record is not None)
        assert (cards.largest == "18.950 mm") == (record is not None)
    assert drawn
