"""Measure the house: `python .ci/house.py [--at COMMIT]`.

Files, lines of code (no blank line, comment or docstring), lines of imports and functions by room;
complexity; then what one `size` of the README's truck runs, and what short commands load.
Ratios between two commits count, measured by this file on one machine.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import os
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter
from pathlib import Path

HOUSE = Path(__file__).parents[1]
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip
MANY_BRANCHES = 30  # above it a block is counted as hard to follow


def measure(file: Path) -> Counter[str]:
    """Lines of code, lines of imports and functions of one file."""
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    docs: set[int] = set()
    imports: set[int] = set()
    functions = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                docs.update(_lines(node))
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            imports.update(_lines(node))
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            functions += 1
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    code -= docs
    return Counter(files=1, code=len(code), imports=len(imports & code), functions=functions)


def _lines(node: ast.stmt) -> range:
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


def rooms(folder: Path) -> dict[str, Counter[str]]:
    """What `measure` counts, added up by the folders below a folder."""
    found: dict[str, Counter[str]] = {}
    for file in sorted(folder.rglob("*.py")):
        place = file.relative_to(folder).parts[:-1]
        room = "/".join(place[:2] if place[:1] == ("methods",) else place[:1]) or "."
        found.setdefault(room, Counter()).update(measure(file))
    return found


def complexities(folder: Path) -> list[int]:
    """McCabe's number of each function, by ruff."""
    ruff = Path(sys.executable).with_name("ruff")
    command = [
        ruff, "check", "--isolated", "--exit-zero", "--select", "C901",
        "--config", "lint.mccabe.max-complexity=0", "--output-format", "json", folder,
    ]  # fmt: skip
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    # a message ends with "(NUMBER > 0)"
    return [int(each["message"].rsplit("(", 1)[1].split()[0]) for each in json.loads(told)]


SIZE = """
import contextlib, io, sys
package, scene = sys.argv[1:]
ran, depth, deepest = set(), 0, 0
def watch(frame, event, _):
    global depth, deepest
    code = frame.f_code
    if not code.co_filename.startswith(package):
        return
    if event == "call":
        ran.add(code)
    if event in ("call", "return") and code.co_name != "<module>":
        depth += 1 if event == "call" else -1
        deepest = max(deepest, depth)
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
    sys.setprofile(watch)
    import stochvi.cli
    stochvi.cli.main(["size", scene, "--probability", "1%"])
sys.setprofile(None)
functions = [each for each in ran if each.co_flags & 1 and each.co_name[0] != "<"]
print(len(ran), len(functions), len({each.co_filename for each in ran}), deepest)
"""

LOADED = """
import sys, time, contextlib, io, os
begin = time.process_time()
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
    exec(sys.argv[1])
own = sum(name.split(".")[0] == "stochvi" for name in sys.modules)
print(own, len(sys.modules), round(time.process_time() - begin, 3))
"""


def in_house(house: Path, code: str, *arguments: str) -> list[str]:
    """The words that a piece of code prints last, run with the package of a house."""
    environment = os.environ | {"PYTHONPATH": str(house), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code, *arguments]
    # Python looks first into the folder where it starts
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=house, check=True
    )
    return done.stdout.split("\n")[-2].split()


def truck_of(readme: Path) -> str:
    """The first scene file of the README."""
    return readme.read_text(encoding="utf-8").split("```toml\n", 1)[1].split("```", 1)[0]


def tell(house: Path) -> None:
    for name in ("stochvi", "tests"):
        found = rooms(house / name)
        print(f"{name:28}{'files':>8}{'code':>8}{'imports':>9}{'functions':>11}")
        whole: Counter[str] = Counter()
        for room, counts in found.items():
            whole.update(counts)
            if name == "stochvi":
                _row(room, counts)
        _row("all", whole)
    each = complexities(house / "stochvi")
    hard = sum(number > MANY_BRANCHES for number in each)
    print(f"complexity: mean {sum(each) / len(each):.2f}, {hard} functions above {MANY_BRANCHES}")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "truck.toml")
        scene.write_text(truck_of(house / "README.md"), encoding="utf-8")
        in_house(house, LOADED, _command("size", str(scene), "--probability", "1%"))  # kernels
        bodies, functions, files, depth = in_house(house, SIZE, str(house / "stochvi"), str(scene))
        print(
            f"one size runs {functions} functions in {files} files, {depth} calls deep; {bodies} "
            "with comprehensions and the bodies of classes and files"
        )
        jobs = {
            "import stochvi": "import stochvi",
            "stochvi --version": _command("--version"),
            "stochvi screen": _command("screen", str(scene)),
            "stochvi simulate": _command("simulate", str(scene), "--rel-error", "0.01"),
            "stochvi size": _command("size", str(scene), "--probability", "1%"),
            "imports of all": "import numpy, scipy.special, numba",
        }
        for job, code in jobs.items():
            runs = [in_house(house, LOADED, code) for _ in range(3)]
            own, loaded, seconds = min(runs, key=lambda words: float(words[2]))
            print(f"{job}: {own} modules of stochvi, {loaded} in all, {seconds} s of CPU time")


def _command(*words: str) -> str:
    return f"import stochvi.cli; stochvi.cli.main({list(words)!r})"


def _row(room: str, counts: Counter[str]) -> None:
    numbers = f"{counts['files']:8}{counts['code']:8}{counts['imports']:9}{counts['functions']:11}"
    print(f"  {room:26}{numbers}")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--at", metavar="COMMIT", help="measure a commit, not the checkout")
    commit = arguments.parse_args().at
    if commit is None:
        tell(HOUSE)
        return
    with tempfile.TemporaryDirectory() as folder:
        house = Path(folder, "house")
        tree = ["git", "-C", str(HOUSE), "worktree"]
        subprocess.run([*tree, "add", "--quiet", "--detach", str(house), commit], check=True)
        try:
            tell(house)
        finally:
            subprocess.run([*tree, "remove", "--force", str(house)], check=True)


if __name__ == "__main__":
    main()
