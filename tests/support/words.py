"""Terms that are not used any more, and where they still stand: `python tests/support/words.py`.

The vocabulary is in the glossary of the manual. Docstrings, comments and texts of several words are
looked through, of pages all but code. Counts by room are kept in `tests/words.toml` and may only
fall: `python tests/support/words.py` writes those of now.
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]

COUNTS = CHECKOUT / "tests" / "words.toml"
"""The file of the counts."""

TERMS = {
    "chance, say probability": r"(?<!by )\bchances?\b",
    "hits, say impacts": r"(?<!\bit )\bhits\b(?! (?:a|an|the|its|it|them|both|each)\b)",
    "a hit, say an impact": r"\b(?:a|an|any|each|every|one|first|per|hard|single|last) hit\b",
    "collision, say impact": r"\bcollisions?\b",
    "bounce, say impact": r"\bbounces?\b",
    "blow, say impact": r"\bblows?\b",
    "burst, say cluster": r"\bbursts?\b",
    "gives way, say compliant": r"\bgiv(?:e|es|ing) way\b",
    "wall, say stop": r"\bwalls?\b(?!\s+(?:time|clock)\b)",
    "flown, say simulated": r"\b(?:flown|flies|fly)\b",
    "sentences that begin with Of": r"(?:^(?-i:Of)|[.;]\s+of) (?:an?|the|several|one|all|its)\b",
    "what is told, name it": r"\bwhat (?:is|was) (?:told|asked|said|done)\b",
    "disturbance, say perturbation": r"\bdisturbances?\b",
    "law, say distribution": r"\b(?:normal|Gaussian|Rayleigh|stationary|Gibbs|Student's) laws?\b",
    "lossy stop, say inelastic stop": r"\blossy stops?\b",
    "hit rate, say impact rate": r"\bhit rates?\b",
}  # fmt: skip
"""Patterns of variants, with the word to use. The verb "hits", "by chance" and "wall time" stay."""

HAMMERS = r"\b(?:hammers?|percussion)\b"
"""Words of a text that may speak of blows."""

LONGEST = 25
"""Largest number of words of a sentence."""

LONG = f"sentences of more than {LONGEST} words"
"""Name of the count of long sentences."""

EXAMPLE = r"^ *>>> .*(?:\n(?! *\n).*)*"
"""Pattern of an example with its output, up to an empty line."""

PARAMETERS = r"^( *)\w+(?:, \w+)*(?: :.*)?\n(?=\1 +\S)|^ *-+$"
"""Pattern of the names of parameters above their description, and of lines below headings."""

FORMULAS = r"(?<=\n\n)(?: {4,}.* = .*\n| {4,}[-+].*\n)+"
"""Pattern of formulas that stand apart, in a text without the indentation of its code."""

CODE = r"\"[a-z_]+\"|`[^`]*`|\$[^$]*\$|\]\([^)]*\)|\{[^{}]*\}|--[a-z][a-z-]*"
"""Pattern of values in quotes, code, formulas, targets of links, gaps of texts, and options."""


def texts_of_code(path: Path) -> Iterator[str]:
    """Comments, texts of several words, and docstrings without formulas, examples and names."""
    source = path.read_text(encoding="utf-8")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string.lstrip("# ")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            text = re.sub(FORMULAS, "", inspect.cleandoc(node.value))
            yield re.sub(f"{EXAMPLE}|{PARAMETERS}", "\n", text, flags=re.MULTILINE)


def texts_of_page(path: Path) -> Iterator[str]:
    """The prose of a page, without fenced blocks."""
    text = path.read_text(encoding="utf-8")
    yield re.sub(r"^(```+).*?^\1", "", text, flags=re.DOTALL | re.MULTILINE)


def prose(text: str) -> str:
    """A text without code, values in quotes, formulas and targets of links."""
    return re.sub(CODE, " # ", text)


def rooms() -> dict[str, list[Path]]:
    """Files by room: what a user reads has rooms of its own, and the rest of the package is one, so
    that a text may move within it."""
    found = {name: [CHECKOUT / name] for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")}
    for path in sorted((CHECKOUT / "stochvi").rglob("*.py")):
        part = path.relative_to(CHECKOUT).parts[1]
        room = f"stochvi/{part}" if part in ("cli", "views") else "stochvi"
        found.setdefault(room, []).append(path)
    for folder in ("docs", "studies"):
        found[folder] = [
            path for path in sorted((CHECKOUT / folder).rglob("*.md"))
            if not {"_build", "generated"} & set(path.parts)
        ]  # fmt: skip
    return found


def counts() -> dict[str, dict[str, int]]:
    """How often each variant stands in each room; a variant that is absent is left out."""
    found: dict[str, dict[str, int]] = {}
    for room, paths in rooms().items():
        here: Counter[str] = Counter()
        for path in paths:
            read = texts_of_code if path.suffix == ".py" else texts_of_page
            for text in map(prose, read(path)):
                for name, pattern in TERMS.items():
                    if name.startswith("blow") and re.search(HAMMERS, text, flags=re.IGNORECASE):
                        continue
                    here[name] += len(re.findall(pattern, text, flags=re.IGNORECASE))
                here[LONG] += long_sentences(text)
        found[room] = {name: number for name, number in sorted(here.items()) if number}
    return found


def long_sentences(text: str) -> int:
    """Sentences of more than `LONGEST` words; rows of tables and lists end a sentence.

    >>> long_sentences("One two. " + 26 * "word " + ".")
    1
    """
    parts = re.split(r"[.;:?!][*_)\"']*(?=\s|$)|\n\s*\n|\n\s*[-|*\d]", text)
    return sum(len(re.findall(r"[^\W\d_][\w'-]*", part)) > LONGEST for part in parts)


if __name__ == "__main__":
    lines = ["# Counts of variants by room, which may only fall: `python tests/support/words.py`."]
    for room, here in sorted(counts().items()):
        lines += ["", f'["{room}"]', *(f'"{name}" = {number}' for name, number in here.items())]
    COUNTS.write_text("\n".join(lines) + "\n", encoding="utf-8")
