"""The demo, a report and a part of the suite with other versions of the dependencies.

`python .ci/versions.py lowest` takes the lowest that pyproject allows: each bound `NAME>=VERSION`
becomes `NAME==VERSION`. `prereleases` takes the newest, finished or not. pip makes an environment
of its own from its usual index, and this script removes it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]

PART = (
    "tests/results", "tests/scenes/test_scenes.py", "tests/scenes/test_schema.py",
    "tests/mathematics",
)  # fmt: skip
"""Rooms that meet all dependencies, and need few kernels."""

LEFT_OUT = "not (HarmonicResponse or BumperMap or AbsorberReport)"
"""Answers whose kernels take a minute to compile."""

TOOLS = (
    "pytest", "pytest-random-order", "pytest-xdist", "hypothesis", "mpmath", "jsonschema", "xarray",
)  # fmt: skip
"""What this part of the suite needs, in versions that pip chooses: no user needs it."""

PICTURES = ("demo", "size")
"""Folders in which a picture has to be."""


def lowest(dependencies: list[str]) -> list[str]:
    """Dependencies with the lowest version that each allows.

    >>> lowest(["numpy>=1.26", "scipy"])
    Traceback (most recent call last):
    ValueError: dependencies must have a lowest version, as NAME>=VERSION, got scipy
    """
    for each in dependencies:
        if each.count(">=") != 1 or "," in each:
            raise ValueError(
                f"dependencies must have a lowest version, as NAME>=VERSION, got {each}"
            )
    return [each.replace(">=", "==") for each in dependencies]


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        venv.create(home / "environment", with_pip=True)
        scripts = home / "environment" / ("Scripts" if os.name == "nt" else "bin")
        alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        alone |= {"MPLBACKEND": "agg"}

        def run(*command: str | Path) -> None:
            print("$", *command, flush=True)
            subprocess.run([scripts / command[0], *command[1:]], check=True, cwd=ROOT, env=alone)

        wheels = ("python", "-m", "pip", "install", "--quiet", "--only-binary", ":all:")
        if sys.argv[1:] == ["prereleases"]:
            run(*wheels, "--pre", *project["dependencies"], *TOOLS)
            run("python", "-m", "pip", "list", "--pre")
        else:
            run(*wheels, *lowest(project["dependencies"]), *TOOLS)
        run("python", "-m", "pip", "install", "--quiet", "--no-deps", "--editable", ".")
        run("python", "-m", "pip", "check")
        run("stochvi", "demo", "--theory", "--out", home / "demo")
        run("stochvi", "new", home / "road.toml", "--kind", "road")
        run("stochvi", "size", home / "road.toml", "--probability", "1%", "--mission", "10min",
            "--rel-error", "0.1", "--out", home / "size")  # fmt: skip
        for name in PICTURES:
            if not list((home / name).rglob("*.png")):
                sys.exit(f"{name} has drawn no picture")
        run(
            "python",
            "-m",
            "pytest",
            "-q",
            "--disable-warnings",
            "-n",
            "auto",
            "-k",
            LEFT_OUT,
            *PART,
        )


if __name__ == "__main__":
    main()
