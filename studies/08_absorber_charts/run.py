"""What loose masses in boxes do to a lightly damped structure under random excitation."""

import argparse
import csv
from pathlib import Path

import cases
import drawing
import pandas as pd

CHARTS = Path(__file__).parents[2] / "data" / "absorber_charts" / "charts.csv"


def compute(cells: list[dict], file: Path, paths: int) -> pd.DataFrame:
    """Rows of the cells, written as they come: an interrupted run goes on where it was."""
    done = list(csv.DictReader(file.open(encoding="utf-8", newline=""))) if file.exists() else []
    for cell in cases.missing(cells, done):
        row = pd.DataFrame([cases.row(cell, paths)])
        row.to_csv(file, mode="a", header=not file.exists(), index=False)
    return pd.read_csv(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few cells of fewer paths")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    chosen = cases.grid()[2:8:2] if options.quick else cases.grid()
    paths = 4 if options.quick else cases.PATHS
    charts = compute(chosen, options.out / "result.csv", paths)
    dampers, no_help = cases.dampers(), cases.no_help(paths)
    for name, table in (("dampers", dampers), ("no_help", no_help)):
        table.to_csv(options.out / f"{name}.csv", index=False)
    if not options.quick:
        charts.drop(columns="cpu_seconds").to_csv(CHARTS, index=False)
        drawing.draw(charts, dampers).savefig(options.out / "figure.png", dpi=150)
    print(cases.against_table(charts).round(3).to_string(), no_help, sep="\n")
