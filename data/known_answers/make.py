"""Computes answers.csv: the zoo by closed form, and else by the Fokker-Planck equation."""

import argparse
import csv
from pathlib import Path

import stochvi

RTOL = 1e-6
"""Asked of the Fokker-Planck equation; what was reached stands in the column bias."""

HEADER = (
    "# Known answers of data/scenes/zoo, SI units (units of a quantity: QUANTITY_UNITS).",
    "# bias: bound on the error of value. speed_threshold: rates count impacts above it, m/s.",
)


def threshold_of(scene: stochvi.Scene) -> float:
    """The speed above which `simulate` counts impacts of a scene of one impact pair."""
    for pair in stochvi.simulate(scene, paths=2, threads=1).impact_pairs.values():
        threshold = pair["speed_threshold"]
        assert isinstance(threshold, float)
        return threshold
    return 0.0


def known(scene: stochvi.Scene) -> stochvi.Response | None:
    """The most certain answer there is; None where only simulation answers."""
    try:
        return stochvi.exact(scene)
    except stochvi.results.NoExactSolution:
        pass
    try:
        return stochvi.fokker_planck(scene, rtol=RTOL, speed_threshold=threshold_of(scene))
    except stochvi.NotConverged as reason:
        return reason.response
    except stochvi.NotApplicable:
        return None


def rows(name: str, response: stochvi.Response) -> list[tuple[object, ...]]:
    """One line for each quantity whose error is known."""
    found = []
    for (of, quantity), estimate in response.estimates().items():
        if estimate.bias is not None:
            pair = response.impact_pairs.get(of, {})
            bias, threshold = f"{estimate.bias:.2g}", f"{pair.get('speed_threshold', 0.0):.12g}"
            value = f"{estimate.value:.14g}"
            found.append((name, response.method, of, quantity, value, bias, threshold))
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    with (options.out / "answers.csv").open("w", newline="", encoding="utf-8") as file:
        file.write("\n".join([*HEADER, f"# stochvi {stochvi.__version__}, rtol {RTOL:g}"]) + "\n")
        table = csv.writer(file, lineterminator="\n")
        columns = ("scene", "method", "of", "quantity", "value", "bias", "speed_threshold")
        table.writerow(columns)
        for name, scene in stochvi.verification.zoo().items():
            response = known(scene)
            if response is not None:
                table.writerows(rows(name, response))
                file.flush()
