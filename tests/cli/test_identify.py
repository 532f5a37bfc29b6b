"""`stochvi identify`: documents, files, and what it refuses."""

from __future__ import annotations

from pathlib import Path

from support.commands import Run, one_document, refused

SPEEDS = "approach (m/s),rebound (m/s)\n0.5,0.36\n1.0,0.69\n1.5,1.06\n2.0,1.39\n"


def test_a_table_of_speeds_has_a_document_and_files(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "speeds.csv"
    file.write_text(SPEEDS)
    out = tmp_path / "out"
    done = stochvi("identify", str(file), "--test", "speeds", "--out", str(out), "--json", "-")
    assert done.code == 0, done.err
    document = one_document(done.out)
    assert document["method"] == "identify" and document["chosen"] == "constant"
    assert document["line"] == 'law = { kind = "restitution", coefficient = 0.703 }'
    assert document["fits"]["constant"]["rejected"] is None
    assert {each.name for each in out.iterdir()} == {"identify.csv", "curve.csv", "identify.png"}
    told = stochvi("identify", str(file), "--test", "speeds")
    assert "law = { kind" in told.out and "yielding body" in told.out


def test_what_is_no_test_is_refused(stochvi: Run, tmp_path: Path) -> None:
    file = tmp_path / "speeds.csv"
    file.write_text("0.5,0.36\n1.0,0.69\n")
    assert "must be 'm/s,m/s', got none" in refused(
        stochvi("identify", str(file), "--test", "speeds")
    )
    assert "mass must be given" in refused(stochvi("identify", str(file), "--test", "drop"))
    missing = stochvi("identify", str(tmp_path / "none.csv"), "--test", "force")
    assert "cannot be read" in refused(missing)
