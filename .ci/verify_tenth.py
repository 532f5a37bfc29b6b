"""The tenth of `make verify` that was run longest ago, or what ends in some minutes of it:
`python .ci/verify_tenth.py [--log] [--minutes 15] [--share 0.1]`.

`tests/verify_log.csv` holds, for each long test, when it last passed, at which commit, and how
many seconds it took. Tests that never passed come first, then the oldest; ties are drawn by the
commit, so that each run of all checks takes others. `--log` writes what passed into the file, to
be committed.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import hashlib
import math
import statistics
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
LOG = ROOT / "tests" / "verify_log.csv"
SHARE = 0.1
TOGETHER = 4
"""Number of tests that one process pool runs before the clock is looked at."""
PYTEST = [sys.executable, "-m", "pytest", "-m", "verify"]


class Passed(NamedTuple):
    """When a test passed last, and what it took."""

    test: str
    date: str
    commit: str
    seconds: float


def read(log: Path) -> dict[str, Passed]:
    if not log.exists():
        return {}
    with log.open(encoding="utf-8", newline="") as lines:
        rows = (
            Passed(**row)._replace(seconds=float(row["seconds"])) for row in csv.DictReader(lines)
        )
        return {row.test: row for row in rows}


def tenth(
    tests: Iterable[str], log: dict[str, Passed], commit: str, share: float = SHARE
) -> list[str]:
    """Tests run longest ago that take a tenth, or another share, of the time of all.

    >>> log = {name: Passed(name, date, "", 10.0) for name, date in zip("abcdefghi", "987654321")}
    >>> tenth("abcdefghi", log, "")
    ['i']
    >>> tenth("abcdefghij", log, "")  # one that never passed comes first
    ['j']
    """
    usual = statistics.median([row.seconds for row in log.values()] or [1.0])
    never = Passed("", "", "", usual)
    rows = {test: log.get(test, never) for test in tests}

    def turn(test: str) -> tuple[str, str]:
        return rows[test].date, hashlib.sha256((commit + test).encode()).hexdigest()

    left = share * sum(row.seconds for row in rows.values())
    chosen = []
    for test in sorted(rows, key=turn):
        if left <= 0.0:
            break
        chosen.append(test)
        left -= rows[test].seconds
    return chosen


def batched(tests: list[str], number: int) -> list[list[str]]:
    return [tests[first : first + number] for first in range(0, len(tests), number)]


def printed(command: list[str]) -> str:
    return subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout


def collected() -> list[str]:
    """Long tests by file and function; the parameters of a function run together."""
    listed = printed([*PYTEST, "--collect-only", "-q"]).splitlines()
    return sorted({line.split("[")[0] for line in listed if "::" in line})


def seconds_of_passed(report: Path) -> dict[str, float]:
    """Seconds of each function all of whose cases passed, or were skipped."""
    seconds: dict[str, float] = defaultdict(float)
    failed = set()
    for case in ElementTree.parse(report).iter("testcase"):
        test = f"{case.get('file')}::{case.get('name', '').split('[')[0]}"
        seconds[test] += float(case.get("time", 0.0))
        if case.find("failure") is not None or case.find("error") is not None:
            failed.add(test)
    return {test: taken for test, taken in seconds.items() if test not in failed}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--log", action="store_true", help="write what passed into the log")
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="begin none that ends later"
    )
    parser.add_argument("--share", type=float, default=SHARE, help="of the time of all of them")
    wanted = parser.parse_args()
    commit = printed(["git", "rev-parse", "--short=8", "HEAD"]).strip()
    log, tests = read(LOG), collected()
    chosen = tenth(tests, log, commit, wanted.share)
    never = sum(test not in log for test in tests)
    print(f"{len(chosen)} of {len(tests)} long tests; {never} never passed yet", flush=True)
    end, today, failed = time.monotonic() + 60.0 * wanted.minutes, datetime.date.today(), 0
    for group in batched(chosen, TOGETHER):
        longest = max(log[test].seconds if test in log else 0.0 for test in group)
        if time.monotonic() + longest > end:
            print(f"no time before {wanted.minutes:g} minutes: {', '.join(group)}", flush=True)
            continue
        with tempfile.TemporaryDirectory() as folder:
            report = Path(folder) / "report.xml"
            ended = subprocess.run(
                [
                    *PYTEST, "-n", "auto", "--dist", "worksteal", "-o", "junit_family=xunit1",
                    f"--junitxml={report}", *group,
                ],
                cwd=ROOT,
            )  # fmt: skip
            failed |= ended.returncode
            for test, seconds in seconds_of_passed(report).items():
                log[test] = Passed(test, today.isoformat(), commit, round(seconds, 1))
        if wanted.log:
            write(log[test] for test in tests if test in log)
    return failed


def write(rows: Iterable[Passed]) -> None:
    with LOG.open("w", encoding="utf-8", newline="") as lines:
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(Passed._fields)
        writer.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
