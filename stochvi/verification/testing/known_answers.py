"""Known answers to scenes of the zoo; they ship in `data/known_answers`."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from typing import Any

from stochvi.mathematics.arguments import checked
from stochvi.results.estimates import Estimate
from stochvi.results.response import CoordinateResponse, PairResponse, Response
from stochvi.scenes.datasets import data_folder
from stochvi.scenes.scene import Scene
from stochvi.verification.check_of_many import zoo


@checked
def known_answers(*names: str) -> dict[str, Response]:
    """Known responses to scenes of the zoo, by closed form or by the Fokker-Planck equation.

    `method` of a response says by which of them. `bias` of each estimate is a bound on its error,
    0 for a closed form. Scenes that only simulation answers are left out.

    Parameters
    ----------
    *names
        Scenes of the zoo; without names, all scenes that have a known response.

    Returns
    -------
    dict[str, Response]
        Answers by the names of their scenes.

    Raises
    ------
    ValueError
        If no answer to a scene of this name ships.

    See Also
    --------
    stochvi.testing.judge : Judges an integrator by them.

    Examples
    --------
    >>> known = known_answers("elastic-half-sigma", "lossy-0.5")
    >>> known["elastic-half-sigma"].coordinates["x"]["velocity_std"]
    1 [closed form]
    >>> known["lossy-0.5"].method
    'fokker-planck'
    """
    found = _shipped()
    unknown = [name for name in names if name not in found]
    if unknown:
        raise ValueError(
            f"names must be scenes with a known answer, got {unknown[0]!r}; "
            f"known: {', '.join(found)}"
        )
    return {name: found[name] for name in names or found}


@cache
def _shipped() -> Mapping[str, Response]:
    path = data_folder() / "known_answers" / "answers.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    rows: dict[str, list[dict[str, str]]] = {}
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        rows.setdefault(row["scene"], []).append(row)
    scenes = zoo(*rows)
    return {name: _response(scenes[name], entries) for name, entries in rows.items()}


def _response(scene: Scene, rows: list[dict[str, str]]) -> Response:
    method = rows[0]["method"]
    how = "closed form" if method == "exact" else "Fokker-Planck equation, error from two meshes"
    coordinates: dict[str, dict[str, Estimate]] = {
        name: {} for name in scene.expanded.structure.coordinates
    }
    pairs: dict[str, dict[str, Any]] = {}
    for row in rows:
        estimate = Estimate(value=float(row["value"]), bias=float(row["bias"]), how=how)
        if row["of"] in coordinates:
            coordinates[row["of"]][row["quantity"]] = estimate
        else:
            pair = pairs.setdefault(row["of"], {"speed_threshold": float(row["speed_threshold"])})
            pair[row["quantity"]] = estimate
    return Response(
        method=method,
        coordinates={name: CoordinateResponse(**each) for name, each in coordinates.items()},
        impact_pairs={name: PairResponse(**each) for name, each in pairs.items()},
        effects=scene.effects(),
        assumptions=scene.assumptions(),
        provenance={"source": "data/known_answers/answers.csv", "scene": scene.document()},
    )
