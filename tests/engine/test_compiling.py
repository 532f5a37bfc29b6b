"""A kernel is compiled again after anything that it is made of has changed, only then, and once."""

from __future__ import annotations

import gc
import importlib
import os
import pickle
import pkgutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba import int64
from numba.core import caching, config, dispatcher, event
from numba.core.bytecode import FunctionIdentity
from numba.core.compiler import Flags
from numba.core.errors import TypingError

import stochvi.engine as engine
import stochvi.methods.periodic.kernels as periodic_kernels
import stochvi.methods.replay.kernel as replay_kernel
import stochvi.motion.kernels as motion_kernels
from stochvi.engine import compiling
from stochvi.engine.borrowed import borrowed, hold, lent, type_of_borrowed
from stochvi.engine.calls import apart, call_apart
from stochvi.engine.compiling import Ingredients, Kernel, kernel
from stochvi.results.deadline import graceful_interrupt, stood_still
from stochvi.results.errors import Interrupted
from stochvi.sampling.workers import leave_out_of_budgets

FILES = {
    "pretend/__init__.py": "",
    "pretend/total.py": """\
from elsewhere import numbers
from elsewhere.laws import Spring, of_stiffness
from stochvi.engine.borrowed import borrowed
from stochvi.engine.compiling import kernel
from pretend.addend import addend
from pretend.forces import force

by_closure = of_stiffness(1.0)

@kernel
def total(x):
    return x + addend() + numbers.TABLE[1] + numbers.SCALE[0] + by_closure(x)

@kernel
def composed(law, x):
    return force(law, x)

@kernel
def lending(law, x):
    return composed(borrowed(law), x)

@kernel
def alone(x):
    return x
""",
    "pretend/addend.py": """\
import numba

@numba.njit
def addend():
    # the comment
    return 10
""",
    "pretend/forces.py": """\
from stochvi.engine.parts import generic

@generic
def force(law, x):
    "Force, N."
""",
    "elsewhere/__init__.py": "",
    "elsewhere/numbers.py": """\
import numpy as np

TABLE = (0.0, 100.0)
SCALE = np.array([1000.0])
""",
    "elsewhere/laws.py": """\
from typing import NamedTuple
from pretend.forces import force
from stochvi.engine.compiling import kernel

class Spring(NamedTuple):
    stiffness: float

class Pad(NamedTuple):
    stiffness: float

@force.of(Spring)
def _(law, x):
    return law.stiffness * x

@force.of(Pad)
def _(law, x):
    return law.stiffness * x**3

def of_stiffness(stiffness):
    @kernel
    def force_of(x):
        return stiffness * x
    return force_of
""",
}

Load = Callable[[], Any]


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Load]:
    """Import `total` of two packages in a folder of their own, as a new process would."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(config, "CACHE_DIR", "")

    def forget() -> None:
        for name in list(sys.modules):
            if name.partition(".")[0] in ("pretend", "elsewhere"):
                del sys.modules[name]
        importlib.invalidate_caches()

    def again() -> Any:
        forget()
        return importlib.import_module("pretend.total")

    yield again
    forget()


def edit(folder: Path, file: str, old: str, new: str) -> None:
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new), encoding="utf-8")


def called(function: Kernel, *arguments: Any) -> tuple[float, int]:
    """The answer of a kernel, and how often it came from the disk."""
    return function(*arguments), sum(function.stats.cache_hits.values())


def test_a_kernel_is_compiled_again_after_anything_in_it_has_changed(load: Load, tmp_path: Path):
    """Of helpers and numbers of other files and packages, too; numba alone looks at one file."""
    assert called(load().total, 1.0) == (1112.0, 0)
    assert called(load().total, 1.0) == (1112.0, 1)
    for file, old, new, answer in [
        ("pretend/addend.py", "10", "20", 1122.0),
        ("elsewhere/numbers.py", "100.0", "200.0", 1222.0),
        ("elsewhere/numbers.py", "1000.0", "2000.0", 2222.0),
        ("pretend/total.py", "of_stiffness(1.0)", "of_stiffness(3.0)", 2224.0),
        ("elsewhere/laws.py", "stiffness * x\n    return force", "-x\n    return force", 2220.0),
    ]:
        edit(tmp_path, file, old, new)
        assert called(load().total, 1.0) == (answer, 0), file
    assert called(load().total, 1.0) == (2220.0, 1)


def test_a_comment_in_a_helper_has_nothing_compiled_again(load: Load, tmp_path: Path):
    load().total(1.0)
    edit(tmp_path, "pretend/addend.py", "    # the comment\n", "    # another comment\n\n")
    assert called(load().total, 1.0) == (1112.0, 1)


@pytest.mark.parametrize("name", ["composed", "lending"])  # by its numbers, and by its address
def test_a_kernel_of_parts_knows_the_bodies_for_its_own_classes(
    load: Load, tmp_path: Path, name: str
):
    def composed() -> tuple[float, int]:
        module = load()
        return called(getattr(module, name), module.Spring(2.0), 3.0)

    assert composed() == (6.0, 0) and composed() == (6.0, 1)
    edit(tmp_path, "elsewhere/laws.py", "x**3", "x**5")  # of a part that the kernel has not
    assert composed() == (6.0, 1)
    edit(tmp_path, "elsewhere/laws.py", "return law.stiffness * x\n", "return -law.stiffness * x\n")
    assert composed() == (-6.0, 0) and composed() == (-6.0, 1)


def test_of_versions_that_nobody_uses_the_newest_remain(
    load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(compiling, "KEPT", 2)
    for value in range(10, 14):
        edit(tmp_path, "pretend/addend.py", str(value), str(value + 1))
        load().total(1.0)
    assert len(list((tmp_path / "pretend/__pycache__").glob("total.total-*.nbc"))) == 2
    assert called(load().total, 1.0) == (1116.0, 1)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: b"\x80\x05garbage",
        lambda data: b"\x00" * 300,
        lambda data: data[: len(data) // 2],
        lambda data: data[:-900] + bytes([data[-900] ^ 1]) + data[-899:],
    ],
    ids=["empty", "garbage", "zeros", "truncated", "one bit"],
)
def test_a_damaged_file_is_removed_and_compiled_again(
    load: Load, tmp_path: Path, damage: Callable[[bytes], bytes]
):
    load().alone(1.0)
    (file,) = (tmp_path / "pretend/__pycache__").glob("total.alone-*.nbc")
    file.write_bytes(damage(file.read_bytes()))
    assert called(load().alone, 1.0) == (1.0, 0)
    assert called(load().alone, 1.0) == (1.0, 1)


def test_where_the_folder_cannot_be_written_the_cache_is_a_folder_of_the_user(
    load: Load, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home" / "caches"))
    (tmp_path / "pretend/__pycache__").touch()  # a file, which also an administrator cannot use
    alone = load().alone
    alone(1.0)
    assert Path(alone.stats.cache_path).is_relative_to(tmp_path / "home")
    assert called(load().alone, 1.0) == (1.0, 1)


def test_without_any_folder_a_kernel_says_that_it_is_not_kept(
    load: Load, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(compiling, "CompileResultCacheImpl", _no_folder)
    alone = load().alone
    assert alone(1.0) == 1.0
    assert alone.obstacles == ["alone has no folder that can be written"]


def _no_folder(function: Any) -> None:
    raise RuntimeError("no locator available")


RUN_TOGETHER = """\
import os, pathlib, sys, time
from pretend.total import total
here = pathlib.Path(sys.argv[1])
(here / str(os.getpid())).touch()
while len(list(here.iterdir())) < 2:
    time.sleep(0.01)
print(total(1.0), sum(total.stats.cache_hits.values()))
"""


def started(folder: Path, program: str, *arguments: str) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(folder), *sys.path])
    environment = os.environ | {"PYTHONPATH": paths, "NUMBA_CACHE_DIR": ""}
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_of_two_processes_that_need_a_kernel_at_once_one_compiles_it(load: Load, tmp_path: Path):
    ready = tmp_path / "ready"
    ready.mkdir()
    both = [started(tmp_path, RUN_TOGETHER, str(ready)) for _ in range(2)]
    answers = sorted(each.communicate()[0].split() for each in both)
    assert answers == [["1112.0", "0"], ["1112.0", "1"]]


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")
def test_waiting_for_another_process_stops_the_clock_and_hears_ctrl_c(
    load: Load, monkeypatch: pytest.MonkeyPatch
):
    leave_out_of_budgets()
    attempts = iter([False, False, True])
    monkeypatch.setattr(compiling, "_locked", lambda file, byte: next(attempts))
    before = stood_still()
    with compiling.in_turn(Path(load().__file__).with_name("nothing.nbc")):
        assert stood_still() - before >= compiling.BETWEEN_ATTEMPTS
        waited = stood_still()
        assert stood_still() == waited  # the clock goes on

    monkeypatch.setattr(compiling, "_locked", lambda file, byte: False)
    turn = compiling.in_turn(Path(load().__file__).with_name("nothing.nbc"))
    with graceful_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="while kernels were compiled"):
            turn.__enter__()


def test_a_kernel_that_could_not_be_compiled_leaves_no_lock(load: Load, tmp_path: Path):
    edit(tmp_path, "pretend/total.py", "    return x\n", "    return x.missing\n")
    alone = load().alone
    with pytest.raises(numba.TypingError):
        alone(1.0)
    look = f"""\
from stochvi.engine import compiling
compiling.BETWEEN_ATTEMPTS = 600.0
with compiling.in_turn(compiling.Path({str(next(iter(alone._cache._files.values())))!r})):
    print("free")
"""
    assert started(tmp_path, look).communicate(timeout=500)[0] == "free\n"


MAIN = """\
from typing import NamedTuple
from pretend.total import composed, force, Spring
from stochvi.engine.compiling import kernel

class Bump(NamedTuple):
    height: float

@force.of(Bump)
def _(law, x):
    return law.height + x

@kernel
def own(x):
    return 2.0 * x

print(composed(Bump(1.0), 2.0), composed(Spring(2.0), 3.0), own(3.0))
print(*composed.obstacles, *own.obstacles, sep="; ")
"""


def test_what_is_defined_in_the_main_module_is_not_kept_and_says_so(load: Load, tmp_path: Path):
    printed, said = started(tmp_path, MAIN).communicate()[0].splitlines()
    assert printed == "3.0 6.0 6.0"
    assert said.split("; put it into a module")[:-1] == [
        "Bump is defined in __main__",
        "; force_Bump is defined in __main__",
        "; own is defined in __main__",
    ] or ("Bump is defined in __main__" in said and "own is defined in __main__" in said)
    kept = {file.name.partition("-")[0] for file in tmp_path.rglob("*.nbc")}
    assert kept == {"total.composed"}
    module = load()
    assert called(module.composed, module.Spring(2.0), 3.0) == (6.0, 1)


def of_stiffness(stiffness: float) -> tuple[Any, Any]:
    """A kernel that is a closure, and one that calls it."""

    @kernel
    def force(x):
        for _ in range(1000):
            if x > 100.0:
                raise ValueError("so long that it is not put into the caller")
        return stiffness * x

    @kernel
    def twice(x):
        return force(x) + force(x)

    return force, twice


def test_closures_of_several_processes_are_not_taken_for_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Machine code is linked by names; numba numbers functions from 1 in each process."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(FunctionIdentity, "_unique_ids", count(9001))
    of_stiffness(1.0)[1](1.0)
    monkeypatch.setattr(FunctionIdentity, "_unique_ids", count(9001))
    of_stiffness(2.0)[1](1.0)
    soft, hard = (of_stiffness(stiffness)[1] for stiffness in (1.0, 2.0))
    assert called(soft, 1.0) == (2.0, 1) and called(hard, 1.0) == (4.0, 1)

    @numba.njit
    def both(x):
        return soft(x) + 10.0 * hard(x)

    assert both(1.0) == 42.0


def test_functions_as_arguments_are_known_by_their_contents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    def applied() -> Kernel:
        return kernel(apply)

    for stiffness, hits in [(1.0, 0), (2.0, 0), (1.0, 1)]:
        at = applied()
        force = of_stiffness(stiffness)[0]
        assert called(at, force, 3.0) == (3.0 * stiffness, hits)
        assert at(force, 4.0) == 4.0 * stiffness and len(at.overloads) == 1


def apply(function, x):
    return function(x)


def undeclared(x: float) -> float:
    """A function that numba finds by its own means."""
    return x


@numba.extending.overload(undeclared)
def _undeclared(x):
    return lambda x: x + 1.0


def test_a_function_that_numba_finds_otherwise_has_to_be_declared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    asking = kernel(ask)
    assert asking(1.0) == 2.0
    assert asking.obstacles == [
        "undeclared does not declare in `made_of` what numba compiles for it"
    ]
    monkeypatch.setattr(undeclared, "made_of", {object: (_undeclared,)}, raising=False)
    assert kernel(ask)(1.0) == 2.0 and called(kernel(ask), 1.0) == (2.0, 1)


def ask(x):
    return undeclared(x)


@pytest.mark.parametrize("value", [object(), {"a": 1.0}, np.array([None]), lambda: 0.0])
def test_values_of_unknown_kinds_are_obstacles(value: Any) -> None:
    found = Ingredients()
    found.add(value)
    assert found.obstacles


@pytest.mark.parametrize("value", [1, 1.0, -0.0, 0.0, True, np.float64(1.0), np.float32(1.0), "1"])
def test_values_that_differ_in_type_or_sign_differ_in_digest(value: Any) -> None:
    def digest(value: Any) -> str:
        found = Ingredients()
        found.add(value)
        return found.digest()

    others = [1, 1.0, -0.0, 0.0, True, np.float64(1.0), np.float32(1.0), "1"]
    assert sum(digest(value) == digest(other) for other in others) == 1


def modules() -> list[ModuleType]:
    """All modules of the package that hold kernels."""
    found = [replay_kernel]
    for package in (engine, motion_kernels, periodic_kernels):
        for each in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            found.append(importlib.import_module(each.name))
    return found


def test_all_kernels_of_the_package_can_be_kept() -> None:
    kernels = {
        value for module in modules() for value in vars(module).values()
        if isinstance(value, dispatcher.Dispatcher)
    }  # fmt: skip
    assert len(kernels) > 150 and all(isinstance(each, Kernel) for each in kernels)
    for each in kernels:
        found = Ingredients()
        found.add(each)
        found.digest()  # which walks on to the functions that numba chooses
        assert not found.obstacles, each.__name__


def test_nothing_of_the_process_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever imports the package keeps numba and the garbage collector as they were."""
    for method in (dispatcher.Dispatcher.compile, caching.FunctionCache.save_overload):
        assert method.__module__.startswith("numba.") and not hasattr(method, "__wrapped__")
    assert all(
        each.__module__ == "numba.core.caching" for each in caching.CacheImpl._locator_classes
    )
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    seen: list[bool] = []

    class Listener(event.Listener):
        def on_start(self, _: event.Event) -> None:
            seen.append(gc.isenabled())

        def on_end(self, _: event.Event) -> None:
            pass

    with event.install_listener("numba:run_pass", Listener()):
        of_stiffness(5.0)[0](1.0)
    assert seen and all(seen)


@kernel
def root(x):
    if x < 0.0:
        raise ValueError("x must be positive")
    return x**0.5


@kernel
def sum_of_roots(x, y):
    return root(x) + root(y)


@kernel
def difference_of_roots(x, y):
    return root(x) - root(y)


def test_a_function_that_kernels_call_is_made_machine_code_of_only_for_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    assert sum_of_roots(9.0, 4.0) == 5.0
    assert not root.overloads and len(root.linked.overloads) == 1
    (linked,) = root.linked.overloads.values()
    assert linked.library.get_pointer_to_function(linked.fndesc.llvm_func_name) == 0
    assert difference_of_roots(9.0, 4.0) == 1.0
    assert len(root.linked.overloads) == 1
    assert root(9.0) == 3.0
    assert len(root.overloads) == 1
    with pytest.raises(ValueError, match="x must be positive"):
        difference_of_roots(9.0, -4.0)


@pytest.mark.slow
def test_a_function_that_kernels_call_is_compiled_once_for_all_numbers_of_a_type(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    @kernel
    def entry(row, k):  # type: ignore[no-untyped-def]
        return row[k]

    @kernel
    def sum_of(row):  # type: ignore[no-untyped-def]
        return entry(row, 0) + entry(row, k=1)

    assert sum_of(np.array([1.0, 2.0])) == 3.0
    assert len(entry.linked.overloads) == 1


TEXTS = """
import sys
import stochvi
from numba.core import event
from stochvi.scenes.datasets import shipped_scene

class Modules(event.Listener):
    def on_start(self, given):
        print(given.data["dispatcher"].py_func.__module__)

    def on_end(self, given):
        pass

event.register("numba:compile", Modules())
stochvi.simulate(stochvi.load_scene(shipped_scene(sys.argv[1])), paths=2, budget=None)
"""


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["oscillator-lossy", "isolator-truck"])
def test_no_texts_are_compiled_for_errors_that_kernels_cannot_have(
    scene: str, tmp_path: Path
) -> None:
    """numba compiles the message about shapes that differ, with all that joins texts: a second."""
    there = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", TEXTS, scene]
    done = subprocess.run(command, env=there, capture_output=True, text=True, check=True)
    modules = done.stdout.split()
    assert any(each.startswith("stochvi.motion.kernels") for each in modules)
    assert not [each for each in modules if "unicode" in each]


def test_a_linked_kernel_is_read_from_its_file(load: Load, tmp_path: Path) -> None:
    """A second kernel that holds it, in another process, does not compile it again."""
    program = f"""\
import sys
sys.path.insert(0, {str(tmp_path)!r})
from numba.core import event
from pretend.pairs import {{0}}
class Listener(event.Listener):
    def on_start(self, heard):
        print(heard.data["dispatcher"].py_func.__name__)
    def on_end(self, heard):
        pass
with event.install_listener("numba:compile", Listener()):
    print({{0}}(9.0, 4.0))
"""
    (tmp_path / "pretend").mkdir(exist_ok=True)
    (tmp_path / "pretend/__init__.py").touch()
    (tmp_path / "pretend/pairs.py").write_text(
        "from stochvi.engine.compiling import kernel\n"
        "@kernel\ndef root(x):\n    return x**0.5\n"
        "@kernel\ndef total(x, y):\n    return root(x) + root(y)\n"
        "@kernel\ndef rest(x, y):\n    return root(x) - root(y)\n"
    )
    place = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    said = [
        subprocess.run(
            [sys.executable, "-c", program.format(name)],
            capture_output=True, text=True, check=True, env=place,
        ).stdout.split()
        for name in ("total", "rest", "rest")
    ]  # fmt: skip
    assert said == [["total", "root", "5.0"], ["rest", "1.0"], ["1.0"]]


def test_no_full_collection_of_objects_runs_while_a_kernel_is_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Python would look through all objects of numba again and again."""
    seen: list[tuple[int, int, int]] = []
    translate = FunctionIdentity.from_function

    def noting(function: Any) -> Any:
        seen.append(gc.get_threshold())
        return translate(function)

    usual = gc.get_threshold()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(FunctionIdentity, "from_function", noting)
    kernel(lambda x: x + 1.0)(1.0)
    assert seen and all(first >= 100_000 and last >= 1_000_000 for first, _, last in seen)
    assert gc.get_threshold() == usual
    gc.set_threshold(0)  # someone who wants no collection has none
    try:
        kernel(lambda x: x + 2.0)(1.0)
        assert seen[-1][0] == gc.get_threshold()[0] == 0
    finally:
        gc.set_threshold(*usual)


def test_options_of_a_compilation_are_read_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """numba compares them in each call of a function that it finds by `overload`."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    read: list[Flags] = []
    values = Flags.values

    def noting(flags: Flags) -> Any:
        read.append(flags)
        return values(flags)

    monkeypatch.setattr(Flags, "values", noting)

    @kernel
    def inner(x, y):
        return max(x, y) + max(y, x) + min(x, y)

    kernel(lambda x, y: inner(x, y))(1.0, 2.0)
    settled = [flags for flags in read if isinstance(flags, compiling.SettledFlags)]
    assert settled and len(settled) == len(set(map(id, settled)))
    asked = compiling.ComparedFlags(Flags())
    assert asked.copy() == Flags() and hash(asked.copy()) == hash(Flags())
    asked.forceinline = True
    assert asked.copy() != Flags()


def test_a_kernel_travels_by_its_name() -> None:
    for module in modules():
        for name, value in vars(module).items():
            if isinstance(value, Kernel) and value.__module__ == module.__name__:
                assert pickle.loads(pickle.dumps(value)) is getattr(module, name)


@pytest.mark.verify
def test_numba_alone_keeps_the_old_kernel(load: Load, tmp_path: Path):
    """The control: once numba looks at all that is in a kernel itself, the digests can go."""
    edit(
        tmp_path,
        "pretend/total.py",
        "@kernel\ndef total",
        "import numba\n@numba.njit(cache=True)\ndef total",
    )
    edit(tmp_path, "pretend/total.py", " + by_closure(x)", "")
    assert called(load().total, 1.0) == (1111.0, 0)
    edit(tmp_path, "pretend/addend.py", "10", "20")
    assert called(load().total, 1.0) == (1111.0, 1)


def test_a_numba_that_lacks_what_kernels_use_is_refused_in_a_sentence() -> None:
    program = (
        "from numba.core import codegen\n"
        "del codegen.CPUCodeLibrary._get_module_for_linking\n"
        "import stochvi.engine.compiling\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode
    assert (
        "has no JITCodeLibrary._get_module_for_linking, which kernels use; install" in done.stderr
    )


def test_kernels_that_are_not_compiled_are_announced_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their digits are others than those of the same seed elsewhere."""
    monkeypatch.setattr(compiling.config, "DISABLE_JIT", True)
    compiling._say_uncompiled.cache_clear()
    with pytest.warns(UserWarning, match="NUMBA_DISABLE_JIT is set") as told:
        assert [compiling.kernel(each) for each in (abs, max)] == [abs, max]
    assert len(told) == 1
    compiling._say_uncompiled.cache_clear()


# ------------------------------------------------------------------------------
# What is borrowed is what it was made from; owners are not counted, and tuples are addresses.
# ------------------------------------------------------------------------------


class Inner(NamedTuple):
    """Arrays in a tuple of a tuple."""

    numbers: np.ndarray
    counts: np.ndarray
    absent: None


class Outer(NamedTuple):
    """A tuple that holds another one."""

    table: np.ndarray
    inner: Inner
    step: float


@kernel
def add(outer, text):
    """Change all arrays; returns what was given with them."""
    outer.table[1, 0] += outer.step
    outer.inner.numbers[2] -= 1.0
    outer.inner.counts[0] += 1
    return text


@kernel
def borrow_and_add(outer, text):
    """Borrow twice: a borrowed array is borrowed as it is."""
    again = borrowed(borrowed(outer))
    return add(again, borrowed(text))


@kernel
def ask_for_more(outer):
    """Ask a tuple for a member that it has not."""
    return borrowed(outer).inner.more


@kernel
def make_and_sum(size):
    """The sum of an array that is made, changed and given back here."""
    room = Inner(np.zeros(size), np.ones(size, np.int64), None)
    lent = borrowed(room)
    for i in range(size):
        lent.numbers[i] += lent.counts[i] + i
    total = lent.numbers.sum()
    hold(room)
    return total


def arrays() -> Outer:
    inner = Inner(np.arange(4.0), np.zeros(2, np.int64), None)
    return Outer(np.arange(6.0).reshape(3, 2), inner, 0.5)


def owners(outer: Outer) -> list[int]:
    each: tuple[Any, ...] = (outer.table, outer.inner.numbers, outer.inner.counts)
    return [sys.getrefcount(array) for array in each]


def test_what_is_borrowed_is_changed() -> None:
    outer, before = arrays(), None
    for _ in range(2):
        before = owners(outer)
        assert borrow_and_add(outer, "text") == "text"
    assert owners(outer) == before
    assert outer.table[1, 0] == 3.0
    assert outer.inner.numbers.tolist() == [0.0, 1.0, 0.0, 3.0]
    assert outer.inner.counts.tolist() == [2, 0]


class Mixed(NamedTuple):
    """Numbers of all kinds, with tuples between them."""

    flag: bool
    outer: Outer
    on: bool
    both: tuple[np.ndarray, np.ndarray]
    count: int
    last: bool


@kernel
def read_mixed(mixed, number):
    """Change an array, and return what numbers there are."""
    both = mixed.both
    mixed.outer.table[2, 1] += mixed.outer.step
    both[1][0] = number
    return mixed.flag, mixed.on, mixed.last, mixed.count, both[0].sum(), mixed.outer.inner.counts[1]


def test_what_python_lends_is_what_it_is_made_of() -> None:
    mixed = Mixed(True, arrays(), False, (np.arange(3.0), np.zeros(2, np.uint64)), -7, True)
    for step in (0.5, 2.0):
        given = mixed._replace(outer=mixed.outer._replace(step=step))
        assert read_mixed(lent(given), 9) == (True, False, True, -7, 3.0, 0)
    assert mixed.outer.table[2, 1] == 5.0 + 0.5 + 2.0 and mixed.both[1][0] == 9
    assert len(read_mixed.overloads) == 1 and lent(None) is None
    before = owners(mixed.outer)
    read_mixed(lent(mixed), 9)
    assert owners(mixed.outer) == before


@kernel
def total_of(outer, factor):
    """The sum of a table, as a function that is compiled apart returns it."""
    outer.inner.counts[0] += 1
    return int(factor * outer.table.sum())


@kernel
def ask_apart(function, outer, wanted):
    """Call a function by its address, where it is wanted."""
    return call_apart(function, (outer, 2.0)) if wanted else -1


def test_a_function_that_is_not_wanted_is_not_compiled() -> None:
    outer, compiled = arrays(), len(total_of.overloads)
    absent = apart(total_of, (outer, 2.0), wanted=False, returns=int64)
    assert ask_apart(absent, lent(outer), False) == -1
    assert len(total_of.overloads) == compiled
    present = apart(total_of, (outer, 2.0), returns=int64)
    assert ask_apart(present, lent(outer), True) == 30
    assert len(total_of.overloads) == compiled + 1 and len(ask_apart.overloads) == 1
    assert outer.inner.counts[0] == 1


def test_a_function_apart_is_called_with_its_own_types() -> None:
    other = apart(total_of, (outer := arrays(), 2), wanted=False, returns=int64)
    with pytest.raises(TypingError, match="No match"):
        ask_apart(other, lent(outer), True)


def test_a_tuple_is_handed_on_by_its_address() -> None:
    kind, context = type_of_borrowed(None)(numba.typeof(arrays())), add.targetctx
    assert context.get_value_type(kind).is_pointer and kind.instance_class is Outer
    assert not context.get_value_type(kind.kind).is_pointer


def test_what_a_tuple_does_not_have_is_asked_for_in_vain() -> None:
    with pytest.raises(TypingError, match="Unknown attribute 'more'"):
        ask_for_more(arrays())


def test_an_array_lives_as_long_as_it_is_held() -> None:
    assert [make_and_sum(1000) for _ in range(100)] == [1000.0 + 499500.0] * 100
