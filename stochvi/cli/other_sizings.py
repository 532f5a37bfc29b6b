"""`size --map`, `size --damage-ratio`, and `size` of a scene with phases."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from stochvi.cli.options import Common, band, fail_unless_gaussian, judged_record, shown

if TYPE_CHECKING:
    from stochvi.isolators.record_verdict import RecordVerdict
    from stochvi.mathematics.arrays import Vector
    from stochvi.scenes.scene import Scene

AXES = ("clearance", "stiffness")
"""Axes of the map."""

POINTS = 20
"""Number of values of an axis where only its ends are given."""

OTHER = ("wanted", "pad_force", "rattle_space", "damage_ratio", "equipment", "q", "exponent")
"""Options of `size` that are for a map, or for damage."""

TARGETS = ("probability", "rate", "impact_speed", "peak_acceleration")
NEVER_WITH = ("at", "pair", "common", "sensitivity", "tolerances")
"""Targets of `size`, and its options that do not go with a map, damage or phases."""


def other_sizing(
    options: Common, scene: str, loaded: Scene, given: dict[str, Any], other: dict[str, Any]
) -> bool:
    """Show a map, a sizing by damage or one of phases, if one of them is asked for.

    `scene` is the file of the scene, `given` are the arguments of `size`, and `other` those of
    `OTHER`.
    """
    limits = {name: other[name] for name in ("pad_force", "rattle_space")}
    if other["wanted"] is not None and other["damage_ratio"] is not None:
        raise ValueError("--map must stand without --damage-ratio, got both")
    if other["wanted"] is not None:
        _refuse("--map", given, (*NEVER_WITH, *(set(TARGETS) - {"peak_acceleration"})))
        limits["peak_acceleration"] = given["peak_acceleration"]
        _show_map(options, loaded, other["wanted"], limits, _left(given))
        return True
    if any(limit is not None for limit in limits.values()):
        raise ValueError("--pad-force and --rattle-space must stand with --map, got no --map")
    if other["damage_ratio"] is not None:
        never = [name for name in NEVER_WITH if name != "at"]
        _refuse("--damage-ratio", given, (*never, *TARGETS))
        left = {name: each for name, each in _left(given).items() if name != "exceedance"}
        left |= {} if given["at"] is None else {"at": given["at"]}
        _show_damage(options, scene, loaded, other, left)
        return True
    from stochvi.isolators.sizing.method import is_not_gaussian

    if loaded.phases or is_not_gaussian(loaded):
        alone = "noise that is not Gaussian, or shocks,"
        what = "a scene with phases" if loaded.phases else alone
        part = "size one phase, as FILE.toml#PHASE" if loaded.phases else "leave it out"
        _refuse(what, given, tuple(name for name in NEVER_WITH if name != "common"), part)
        _show_phases(options, scene, loaded, given)
        return True
    return False


def names_in(text: str | None) -> list[str]:
    """Names that are separated by commas; none without a text."""
    return [] if text is None else [name.strip() for name in text.split(",")]


def _refuse(
    what: str, given: dict[str, Any], names: tuple[str, ...], instead: str = "leave it out"
) -> None:
    unused = [name for name in names if given[name] not in (None, False)]
    if unused:
        named = ", ".join(f"--{name.replace('_', '-')}" for name in sorted(unused))
        raise ValueError(f"{what} must stand without {named}; {instead}")


def _left(given: dict[str, Any]) -> dict[str, Any]:
    """Arguments that go on to a calculation: those with a value, without targets."""
    unused = (*TARGETS, *NEVER_WITH)
    return {name: each for name, each in given.items() if name not in unused and each is not None}


def _show(
    options: Common, title: str, solve: Callable[..., Any], given: dict[str, Any],
    tell: Callable[..., None], draw: Callable[[Any], Any], report_of: str | None = None,
    record: RecordVerdict | None = None,
) -> None:  # fmt: skip
    """Find an answer and show it; its files have the name `title`. A clearance also gets a report,
    that of the scene file `report_of`; the `record` of an answer that does not judge it itself
    stands before it."""
    judged: list[RecordVerdict | None] = []

    def found() -> Any:
        with options.progress(title) as report:
            return solve(progress=report, **options.sampling, **given)

    def show(answer: Any) -> None:
        judged.append(getattr(answer, "record", None))
        options.show(answer, tell, title, record=record)
        options.draw(title, lambda: draw(answer))
        if options.out is not None and report_of is not None:
            from stochvi.views.report import write_clearance_report

            origin = options.origin(report_of, answer.provenance)
            write_clearance_report(answer, options.out, origin)

    shown(found, show, given)
    for record in judged:
        fail_unless_gaussian(record)


def _show_map(
    options: Common, loaded: Scene, wanted: str, limits: dict[str, float | None],
    given: dict[str, Any],
) -> None:  # fmt: skip
    from stochvi.isolators.bumpers import bumper_map
    from stochvi.views.bumper_map import draw_bumper_map, print_bumper_map

    kept = {name: most for name, most in limits.items() if most is not None}
    solve = partial(bumper_map, loaded, limits=kept, **_ranges(loaded, wanted))  # type: ignore[arg-type]
    _show(
        options, "map", solve, given, print_bumper_map,
        lambda answer: draw_bumper_map(answer, loaded.title), record=judged_record(loaded),
    )  # fmt: skip


def _show_damage(
    options: Common, scene: str, loaded: Scene, other: dict[str, Any], given: dict[str, Any]
) -> None:
    from stochvi.isolators.sizing.by_damage import size_by_damage
    from stochvi.views.sized_missions import plot_damage_sizing, print_damage_sizing

    solve = partial(
        size_by_damage, loaded, ratio=other["damage_ratio"], q=other["q"],
        exponent=other["exponent"], equipment=band("--equipment", other["equipment"]),
    )  # fmt: skip
    _show(options, "damage", solve, given, print_damage_sizing, plot_damage_sizing, scene)


def _show_phases(options: Common, scene: str, loaded: Scene, given: dict[str, Any]) -> None:
    from stochvi.isolators.sizing.method import size
    from stochvi.views.sized_missions import plot_mission_sizing, print_mission_sizing

    common = names_in(given["common"])
    given = {name: each for name, each in given.items() if name not in NEVER_WITH}
    _show(
        options, "phases", partial(size, loaded, common=common), given, print_mission_sizing,
        plot_mission_sizing, scene,
    )  # fmt: skip


def _ranges(scene: Scene, text: str) -> dict[str, Vector]:
    """The axes of "clearance,stiffness", each with the ends that it may have, as
    "clearance=2mm:9mm,stiffness=1e4:1e6:30"."""
    found: dict[str, Vector] = {}
    words = [word.strip().partition("=") for word in text.split(",")]
    if sorted(name.strip() for name, _, _ in words) != sorted(AXES):
        raise ValueError(
            f"--map must be clearance,stiffness, each with or without FIRST:LAST:NUMBER, as "
            f"clearance=2mm:9mm:20,stiffness=1e4:1e6, got {text!r}"
        )
    for name, equals, span in words:
        if not equals:
            continue
        low, high, number = _span(name.strip(), span)
        found |= _axis(scene, name.strip(), low, high, number)
    return found


def _span(name: str, text: str) -> tuple[float, float, int]:
    from stochvi.mathematics.units import measured
    from stochvi.results.sizes import MOST_SPACED, check_size

    words = text.split(":")
    try:
        low, high = (
            measured(word, "length") if name == "clearance" else float(word) for word in words[:2]
        )
        number = int(words[2]) if len(words) == 3 else POINTS
        if len(words) not in (2, 3) or number < 2 or not 0.0 < low < high:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"--map {name} must be FIRST:LAST or FIRST:LAST:NUMBER, rising, got {text!r}"
        ) from None
    check_size(f"--map {name}", number, MOST_SPACED, "ask for fewer")
    return low, high, number


def _axis(scene: Scene, name: str, low: float, high: float, number: int) -> dict[str, Vector]:
    """The values of one axis; stiffnesses are in N/m where the stops are linear springs, else
    factors of the law."""
    import numpy as np

    from stochvi.isolators.bumpers.method import stiffness_of

    if name == "clearance":
        return {"clearances": np.linspace(low, high, number)}
    own = stiffness_of(scene) or 1.0
    return {"stiffness_factors": np.geomspace(low, high, number) / own}
