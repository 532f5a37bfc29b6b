"""One term for each thing: variants that are not used any more become fewer in every room."""

from __future__ import annotations

import tomllib

import pytest

from support import words

KEPT = tomllib.loads(words.COUNTS.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def now() -> dict[str, dict[str, int]]:
    return words.counts()


def test_no_room_says_a_variant_more_often(now: dict[str, dict[str, int]]) -> None:
    more = [
        f"{room}: {name}: {number}, at most {KEPT.get(room, {}).get(name, 0)}"
        for room, here in now.items()
        for name, number in here.items()
        if number > KEPT.get(room, {}).get(name, 0)
    ]
    assert more == [], "use the words of docs/explanation/glossary.md"


def test_variants_are_found_and_code_is_not() -> None:
    text = words.prose("The chance of a hit is `chance`; {chance} blows, $hits$, --first-hits.")
    found = {name for name, pattern in words.TERMS.items() if words.re.search(pattern, text)}
    assert found == {"chance, say probability", "a hit, say an impact", "blow, say impact"}


def test_a_long_sentence_is_found() -> None:
    assert words.long_sentences(f"Short. {'word ' * 26}.") == 1
    assert words.long_sentences(f"Short. {'word ' * 25}.") == 0
