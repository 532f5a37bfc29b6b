"""The documents that commands write are what `stochvi schema answer` says."""

from __future__ import annotations

import jsonschema

from support.commands import ELASTIC, ISOLATOR, Run, one_document

COMMANDS = [
    ("exact", ELASTIC),
    ("fokker-planck", ELASTIC),
    ("first-passage", ELASTIC, "--times", "5,10"),
    ("linearise", ISOLATOR),
    ("average", ELASTIC),
    ("explain", ISOLATOR),
    ("screen", ISOLATOR),
    ("history", ELASTIC, "--duration", "2"),
    ("simulate", ELASTIC, "--paths", "16", "--duration", "10", "--seed", "1"),
]


def test_documents_of_commands_follow_the_schema(stochvi: Run) -> None:
    done = stochvi("schema", "answer")
    valid = jsonschema.Draft202012Validator(one_document(done.out))
    jsonschema.Draft202012Validator.check_schema(valid.schema)
    for command in COMMANDS:
        document = one_document(stochvi(*command, "--quiet", "--json", "-").out)
        assert [each.message for each in valid.iter_errors(document)] == [], command
        assert not valid.is_valid(document | {"no_such_key": 1})


def test_the_schema_of_scenes_is_printed_where_nothing_else_is_asked_for(stochvi: Run) -> None:
    assert "structure" in one_document(stochvi("schema").out)["properties"]
