"""What a release publishes says one thing in all its files, and has no gap to fill."""

from __future__ import annotations

import json
import re
import tomllib

import pytest

from support import CHECKOUT

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))["project"]
WORKFLOWS = sorted((CHECKOUT / ".github" / "workflows").glob("*.yml"))
OF_CONDA = {"matplotlib": "matplotlib-base"}
"""Packages that conda-forge calls by another name."""


def text_of(name: str) -> str:
    return (CHECKOUT / name).read_text("utf-8")


def test_every_file_states_the_same_version_and_description() -> None:
    found = json.loads(text_of("codemeta.json"))
    recipe = text_of("recipe/recipe.yaml")
    assert found["version"] == PROJECT["version"]
    assert f'version: "{PROJECT["version"]}"' in recipe
    assert found["description"] == PROJECT["description"]
    assert f"summary: {PROJECT['description']}" in recipe
    assert found["keywords"] == PROJECT["keywords"]
    assert (
        re.findall(r"^  - (.+)$", text_of("CITATION.cff").split("authors:")[0], re.M)
        == (PROJECT["keywords"])
    )


def test_the_recipe_has_the_dependencies_of_the_package() -> None:
    block = text_of("recipe/recipe.yaml").split("  run:\n")[1].split("\n\n")[0]
    stated = re.findall(r"- (\S+) (\S+)$", block, re.M)
    expected = [("python", PROJECT["requires-python"])]
    for each in PROJECT["dependencies"]:
        name, bound = each.split(">=")
        expected.append((OF_CONDA.get(name, name), f">={bound}"))
    assert stated == expected


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_pins_its_actions_and_states_its_permissions(path) -> None:
    text = path.read_text("utf-8")
    used = re.findall(r"uses: (\S+)(.*)$", text, re.M)
    assert used and all(re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", name) for name, _ in used)
    assert all(re.fullmatch(r"  # v[\d.]+", version) for _, version in used)
    assert re.search(r"^permissions:", text, re.M)
    targets = set(re.findall(r"run: make (\w+)", text))
    assert targets <= set(re.findall(r"^([\w-]+):", text_of("Makefile"), re.M))


@pytest.mark.parametrize("path", [
    *WORKFLOWS, *(CHECKOUT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"),
    CHECKOUT / ".github" / "dependabot.yml", CHECKOUT / "recipe" / "recipe.yaml",
    CHECKOUT / "CITATION.cff",
], ids=lambda path: path.name)  # fmt: skip
def test_a_file_of_yaml_can_be_read(path) -> None:
    yaml = pytest.importorskip("yaml")
    assert isinstance(yaml.safe_load(path.read_text("utf-8")), dict)


GAPS = re.compile(r"TODO|FIXME|example\.(com|org)|your[-_]name|<[\w ]+@|@users\.noreply", re.I)


@pytest.mark.parametrize("name", [
    "CITATION.cff", "CODE_OF_CONDUCT.md", "RELEASING.md", "SECURITY.md", "SUPPORT.md",
    "codemeta.json", "pyproject.toml", "recipe/recipe.yaml",
])  # fmt: skip
def test_no_placeholder_stands_for_what_nobody_has(name) -> None:
    assert GAPS.search(text_of(name)) is None


def test_what_is_missing_is_listed() -> None:
    """An address that is given at last is taken off the list."""
    listed = text_of("RELEASING.md").split("## What nobody has given yet")[1]
    assert ("address of the repository" in listed) == ("urls" not in PROJECT)
    assert ("DOI of" in listed) == ("doi:" not in text_of("CITATION.cff"))
