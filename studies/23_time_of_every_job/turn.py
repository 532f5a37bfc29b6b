"""Time from a knob of `stochvi explore` to its answers in the browser: `python turn.py`.

Each turn moves the natural frequency by a step of its slider and ends in the picture frame after
the answer is painted. It comes while the page still refines the turn before it, as when one turns a
knob on.
"""

import argparse
import os
import re
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

import pandas as pd
from playwright.sync_api import sync_playwright

FOLDER = Path(__file__).parent

SCALES = {"linear": "the linear answer", "rate": "a simulated rate with its interval"}
"""The answers that are timed, by the part of a turn."""

ASK = """([knob, step]) => new Promise((done) => {
  const panel = document.querySelector(".stochvi-explore"), slider = document.getElementById(knob);
  const began = performance.now(), found = {};
  const hear = ({ detail }) => requestAnimationFrame(() => {
    found[detail.part] ??= performance.now() - began;
    if (detail.part !== "rate") return;
    panel.removeEventListener("painted", hear);
    done(found);
  });
  panel.addEventListener("painted", hear);
  slider.value = Number(slider.value) + step;
  slider.dispatchEvent(new Event("input"));
})"""
"""A turn of a knob by a step, in the page; the times of its answers in ms."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turns", type=int, default=50)
    parser.add_argument("--out", type=Path, default=FOLDER)
    asked = parser.parse_args()
    words = [sys.executable, "-m", "stochvi", "explore", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        (address,) = re.findall(r"http://\S+", server.stdout.readline())
        with sync_playwright() as play:
            browser = play.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox"]
            )
            page = browser.new_page(locale="en-US")
            page.goto(address)
            page.wait_for_selector("header .state:text-matches('all known')", timeout=300_000)
            turns = [
                page.evaluate(ASK, ["structure.frequency_hz", 5 if turn % 10 < 5 else -5])
                for turn in range(asked.turns)
            ]
        server.terminate()
    rows = [
        {
            "answer": SCALES[part],
            "median_ms": round(statistics.median(each[part] for each in turns)),
            "largest_ms": round(max(each[part] for each in turns)),
            "turns": len(turns),
            "load": round(os.getloadavg()[0], 1),
        }
        for part in SCALES
    ]
    table = pd.DataFrame(rows)
    asked.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(asked.out / "turn.csv", index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
