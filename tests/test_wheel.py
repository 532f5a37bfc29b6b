"""The wheel carries the data: installed into a fresh environment it finds its profiles."""

import os
import subprocess
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from hatchling.build import build_wheel

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


@pytest.mark.slow
def test_wheel_in_a_fresh_environment_finds_its_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(CHECKOUT)
    wheel = tmp_path / build_wheel(str(tmp_path))
    fresh = tmp_path / "fresh"
    venv.create(fresh, with_pip=False)
    python = fresh / "bin" / "python"
    # a wheel without compiled code is installed by unpacking it, which is all that pip would do
    (packages,) = fresh.rglob("site-packages")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
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
