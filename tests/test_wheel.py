"""The wheel carries the data: installed into a fresh environment it finds its profiles."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

from support import CHECKOUT

PROBE = """
import stochvi, stochvi.scenes.datasets as d
print(stochvi.__file__)
print(len(d.profiles()), d.shipped_scene("isolator-truck").is_file(), d.data_folder())
from stochvi.views.report.pages import Page
from stochvi.results.origin import Origin
page = Page(
    title="t", subtitle="s", verdict="v", cards=[], sections=[],
    origin=Origin(time="2000-01-01", version="0"),
)
print("<html" in page.html(), len(d.scene_files("isolator-bumper")))
"""


def test_wheel_in_a_fresh_environment_finds_its_data(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", str(tmp_path), str(CHECKOUT)], check=True)
    (wheel,) = tmp_path.glob("stochvi-*.whl")
    fresh = tmp_path / "fresh"
    venv.create(fresh, with_pip=False)
    python = fresh / "bin" / "python"
    install = [sys.executable, "-m", "pip", f"--python={python}", "install", "--quiet", "--no-deps"]
    subprocess.run([*install, str(wheel)], check=True)
    # the dependencies are borrowed; the package is not: a path entry ignores editable installs
    borrowed = os.environ | {"PYTHONPATH": sysconfig.get_path("purelib")}
    told = subprocess.run(
        [str(python), "-c", PROBE], check=True, capture_output=True, text=True, env=borrowed,
        cwd=tmp_path,
    ).stdout.splitlines()  # fmt: skip
    assert Path(told[0]).is_relative_to(fresh)
    assert told[1].startswith("8 True")
    assert str(fresh) in told[1]
    assert told[2] == "True 2"
