"""Every page that runs is offered as a notebook, beside its title."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from docutils.nodes import document
    from sphinx.application import Sphinx

HERE = Path(__file__).parent

CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
OPTIONS = re.compile(r"\A(?::[\w-]+:[^\n]*\n)+|\A---\n.*?^---\n", re.DOTALL | re.MULTILINE)
"""Options of a cell, which tell how the page shows it."""

BEGIN = "What the cells of the manual use; they write into the folder of the notebook."


def notebook(text: str) -> str:
    """A page of the manual as a notebook, without the outputs of its cells."""
    text = text.split("\n---\n", 1)[1]
    parts = CELL.split(text)
    cells = [cell("markdown", BEGIN), cell("code", (HERE / "startup.py").read_text("utf-8"))]
    for place, part in enumerate(parts):
        if place % 2:
            cells.append(cell("code", OPTIONS.sub("", part)))
        elif words := re.sub(r"<!--.*?-->\n?", "", part, flags=re.DOTALL).strip():
            cells.append(cell("markdown", words))
    for number, each in enumerate(cells):
        each["id"] = f"cell-{number}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    found = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(found, indent=1, ensure_ascii=False) + "\n"


def cell(kind: str, source: str) -> dict[str, Any]:
    found: dict[str, Any] = {"cell_type": kind, "metadata": {}, "source": source.strip()}
    return found | ({"execution_count": None, "outputs": []} if kind == "code" else {})


def offer(
    app: Sphinx, name: str, template: str, context: dict[str, Any], tree: document | None
) -> None:
    """Write the notebook of a page that runs, and link it below the title."""
    path = Path(app.srcdir) / f"{name}.md"
    text = path.read_text("utf-8") if tree is not None and path.is_file() else ""
    if "{code-cell}" not in text:
        return
    target = Path(app.outdir) / f"{name}.ipynb"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(notebook(text), encoding="utf-8")
    link = f'<p><a href="{target.name}" download>This page as a notebook</a></p>'
    context["body"] = context["body"].replace("</h1>", f"</h1>\n{link}", 1)


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer them in pages of HTML."""
    app.connect("html-page-context", offer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
