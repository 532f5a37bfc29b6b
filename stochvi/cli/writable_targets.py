"""Checks, before the work of a command, that the files of its answer can be written."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Collection, Sequence
from pathlib import Path

from stochvi.results.errors import SceneError, TargetError
from stochvi.results.origin import named_files


def inputs_of(scenes: Sequence[Path]) -> list[Path]:
    """The scene files, and the files that they name. Unreadable scenes are refused elsewhere."""
    from stochvi.scenes.scene import file_and_phase
    from stochvi.scenes.text_tables import read_text

    found = []
    for named in scenes:
        scene, _ = file_and_phase(named)
        found.append(scene)
        try:
            document = tomllib.loads(read_text(scene))
            found += [scene.parent / name for name in named_files(document)]
        except (SceneError, ValueError, RecursionError):
            continue
    return found


def check_folder_target(folder: Path) -> None:
    """Raise `TargetError` unless a folder can be made here, and files in it."""
    nearest = _nearest(folder)
    if not nearest.is_dir():
        raise TargetError(f"--out must name a folder, but {nearest} is a file; name another folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise TargetError(f"--out {folder}: {nearest} cannot be written to; name another folder")


def check_formats(formats: Collection[str], folder: Path | None, *, has_report: bool) -> None:
    """Raise a ValueError where answers cannot be written in these forms."""
    if formats and folder is None:
        raise ValueError("--formats needs --out, the folder that gets the files")
    if "pdf" not in formats:
        return
    if not has_report:
        raise ValueError("--formats pdf is for a command that writes a report; this one has none")
    from stochvi.views.other_formats import missing_for_pdf

    if missing := missing_for_pdf():
        raise ValueError(f"--formats pdf {missing}")


REPORT, QUESTION = "report.html", re.compile(r'<meta name="stochvi-question" content="(\w*)">')
"""Name of the page of a report, and where it states the question that it answers."""

HEAD = 4000
"""Number of characters at the start of a page that are searched for its question."""


def check_report_target(folder: Path, question: str) -> None:
    """Raise `TargetError` if the folder holds the report of another scene or question."""
    page = folder / REPORT
    if not page.is_file():
        return
    with page.open(encoding="utf-8", errors="replace") as opened:
        found = QUESTION.search(opened.read(HEAD))
    if found is None or found[1] != question:
        raise TargetError(
            f"{page} is the report of another scene or question, and would be replaced; name "
            "another folder with --out, or replace it with --force"
        )


def check_file_target(option: str, file: Path, read: Sequence[Path]) -> None:
    """Raise `TargetError` unless this file can be written, and is none of those that are read."""
    nearest = _nearest(file)
    for each in read:
        if nearest == file and each.exists() and os.path.samefile(file, each):
            raise TargetError(
                f"{option} {file} would replace {each}, which this command reads; name another file"
            )
    if nearest == file:
        if file.is_dir():
            raise TargetError(f"{option} must name a file, but {file} is a folder")
        if not os.access(file, os.W_OK):
            raise TargetError(f"{option} {file} cannot be written to; name another file")
        return
    if not nearest.is_dir():
        raise TargetError(f"{option} {file}: {nearest} is a file, expected a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise TargetError(f"{option} {file}: {nearest} cannot be written to; name another file")


def check_apart(document: Path, checkpoints: Sequence[Path]) -> None:
    """Raise `TargetError` if the document of an answer would replace a checkpoint of its run."""
    for each in checkpoints:
        if os.path.realpath(document) == os.path.realpath(each):
            raise TargetError(
                f"--json {document} and --checkpoint {each} are one file; give each its own name"
            )


def _nearest(path: Path) -> Path:
    """The path itself if it exists, also as a link to nowhere; else the nearest folder that does.

    A name that the system refuses, such as one of 5000 letters, is an OSError, which names it.
    """
    for found in (path, *path.parents):
        if os.path.lexists(found):
            if not found.exists():  # a link to what is not there yet
                target = Path(os.path.realpath(found))
                if os.path.lexists(target):
                    raise TargetError(f"{found} is a link that leads back to itself; remove it")
                return _nearest(target)
            return found
    return Path()
