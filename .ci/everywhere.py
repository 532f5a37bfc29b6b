"""A part of the suite as other machines and other users would run it.

Digits of linear algebra, of numpy, of the C library and of compiled kernels depend on the
processor; words, times and tables on the user's locale, time zone and terminal; and a test may
lean on the one that runs before it. Each run below takes one processor and one user, so that few
runs cover all. What a machine lacks is skipped, and said.
"""

from __future__ import annotations

import datetime
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

PART = (
    "tests/mathematics", "tests/model", "tests/results", "tests/scenes",
    "stochvi/mathematics", "stochvi/model", "stochvi/results", "stochvi/scenes",
    "tests/methods/closed_form", "tests/methods/fokker_planck/test_fokker_planck.py",
    "tests/methods/linearisation", "tests/methods/replay",
    "tests/motion/test_monte_carlo.py",
    "tests/motion/test_random_numbers.py",
    "tests/isolators/test_record_verdict.py", "tests/isolators/test_isolators.py",
    "tests/cli/test_cli.py", "tests/cli/test_quantities.py", "tests/views/test_tables.py",
)  # fmt: skip
"""Rooms that compute with linear algebra or show numbers, and need few kernels."""

BLAS = ("Prescott", "Haswell", "Zen", "SkylakeX")
"""Processors whose kernels OpenBLAS can be told to take, the oldest first."""

LIBM = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable,-FMA4_Usable"
"""Has the C library round exp, sin and their like as on a processor without these instructions."""

USERS = (
    {"LC_ALL": "C", "TZ": "Asia/Kathmandu", "COLUMNS": "60", "PYTHONHASHSEED": "1"},
    {"LC_ALL": "de_DE.UTF-8", "TZ": "America/St_Johns", "COLUMNS": "200", "PYTHONHASHSEED": "2"},
)

START = (
    "import locale, sys, pytest; locale.setlocale(locale.LC_ALL, ''); "
    "sys.exit(pytest.main(sys.argv[1:]))"
)
"""A program that follows the locale of its user, as every program with windows does."""

PROBE = """
import hashlib, json, locale, math
import numpy as np, scipy.linalg, threadpoolctl
try:
    locale.setlocale(locale.LC_ALL, "")
except locale.Error:
    print("null")
    raise SystemExit
libm = [f(0.01 * n) for n in range(1, 2000) for f in (math.exp, math.sin, math.log, math.tan)]
# kernels of another processor end the program at their first instruction that this one lacks
np.linalg.eigvalsh(np.ones((64, 64)) @ np.ones((64, 64)))
pools = threadpoolctl.threadpool_info()
print(json.dumps({
    "blas": sorted({each["architecture"] for each in pools if each["internal_api"] == "openblas"}),
    "numpy": np.show_config(mode="dicts")["SIMD Extensions"].get("found", []),
    "libm": hashlib.sha256(np.array(libm).tobytes()).hexdigest(),
}))
"""

Variables = dict[str, str]


class Result(NamedTuple):
    passed: bool
    text: str


def found(**variables: str) -> Any:
    """Return what numpy, OpenBLAS and the C library take under these variables.

    It is None without the locale, or where the processor lacks instructions that they ask for.
    """
    done = subprocess.run(
        [sys.executable, "-c", PROBE], env=os.environ | variables, capture_output=True, text=True
    )
    if done.returncode == -signal.SIGILL:
        return None
    done.check_returncode()
    return json.loads(done.stdout)


def processors(folder: Path) -> tuple[list[tuple[str, Variables]], list[str]]:
    """Names and variables of processors that differ from this one, and why others are left out."""
    own = found()
    chosen: list[tuple[str, Variables]] = []
    left_out = []
    seen = {tuple(own["blas"]): "this processor itself"}
    for name in BLAS:
        taken = found(OPENBLAS_CORETYPE=name)
        blas = tuple(taken["blas"]) if taken else ()
        if taken is None:
            left_out.append(f"{name}: this processor lacks instructions that its kernels take")
        elif not blas:
            left_out.append(f"{name}: numpy does not use OpenBLAS here")
        elif blas in seen:
            left_out.append(f"{name}: OpenBLAS takes the kernels of {seen[blas]}")
        else:
            seen[blas] = name
            chosen.append((name, {"OPENBLAS_CORETYPE": name}))
    oldest = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(own["numpy"]),
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CACHE_DIR": str(folder / "numba"),
        "GLIBC_TUNABLES": LIBM,
    }
    if not own["numpy"]:
        left_out.append("NPY_DISABLE_CPU_FEATURES: numpy uses no features that can be disabled")
        del oldest["NPY_DISABLE_CPU_FEATURES"]
    if found(GLIBC_TUNABLES=LIBM)["libm"] == own["libm"]:
        left_out.append("GLIBC_TUNABLES: the C library rounds in one way here")
        del oldest["GLIBC_TUNABLES"]
    # the rest of the oldest processor goes with its kernels of OpenBLAS, where it has some
    name, blas_of_oldest = chosen.pop(0) if chosen else ("generic", {})
    chosen.insert(0, (name, blas_of_oldest | oldest))
    if len(chosen) < len(USERS):
        chosen.append(("this processor", {}))
    return chosen, left_out


def users(folder: Path) -> tuple[list[Variables], list[str]]:
    """The users whose locale there is, or can be made without being root."""
    chosen, left_out = [], []
    for user in USERS:
        name = user["LC_ALL"]
        language, _, charmap = name.partition(".")
        if found(LC_ALL=name) is None and shutil.which("localedef"):
            command = ["localedef", "-i", language, "-f", charmap, str(folder / name)]
            subprocess.run(command, capture_output=True, check=False)
            user = user | {"LOCPATH": str(folder)}
        if found(**user) is None:
            left_out.append(f"{name}: this system neither has it nor can make it; C instead")
            user = user | {"LC_ALL": "C"}
        chosen.append(user)
    return chosen, left_out


def run(kind: str, variables: Variables, arguments: list[str], folder: Path) -> Result:
    """Run the part of the suite in one process, in random order; what it prints stays in a file."""
    order = f"{datetime.date.today():%Y%m%d}{variables['PYTHONHASHSEED']}"
    options = ["-n", "0", "-q", "-p", "no:cacheprovider", "--random-order-bucket=module"]
    command = [sys.executable, "-c", START, *options, f"--random-order-seed={order}", *arguments]
    began, printed = time.monotonic(), folder / f"{kind}.txt"
    with printed.open("wb") as file:
        done = subprocess.run(
            command, env=os.environ | variables, stdout=file, stderr=subprocess.STDOUT, check=False
        )
    text = printed.read_text(encoding="utf-8", errors="replace").strip()
    last = f"{text.splitlines()[-1].strip('= ')} ({time.monotonic() - began:.0f} s)" if text else ""
    if done.returncode:
        again = shlex.join([*(f"{key}={value}" for key, value in variables.items()), *command])
        last = f"{last}\n{text[-20_000:]}\nagain: env {again}\n"
    return Result(done.returncode == 0, last)


def main(arguments: list[str]) -> int:
    """Print a line for each setting; 1 if a test failed in one of them."""
    folder = Path(sys.prefix) / "everywhere"  # kernels and locale stay for the next time
    folder.mkdir(exist_ok=True)
    kinds, lacking = processors(folder)
    people, without = users(folder)
    for reason in (*lacking, *without):
        print(f"skipped {reason}", flush=True)
    settings = [
        (kind, variables | people[number % len(people)])
        for number, (kind, variables) in enumerate(kinds)
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        # the first takes longest, because it compiles kernels of its own
        results = pool.map(lambda each: run(*each, arguments or list(PART), folder), settings)
        passed = []
        for (kind, variables), result in zip(settings, results, strict=True):
            shown = ", ".join(
                f"{key}={value}" for key, value in variables.items() if str(folder) not in value
            )
            word = "passed" if result.passed else "FAILED"
            print(f"{word}  {kind}; {shown}: {result.text}", flush=True)
            passed.append(result.passed)
    return 0 if all(passed) else 1


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
