"""How kernels are compiled, and kept on the disk. Chapters: the digest of everything that a kernel
is made of (`Ingredients`); the decorator `kernel`, the files of compiled code, and processes that
wait for each other."""

from __future__ import annotations

import gc
import hashlib
import logging
import os
import pickle
import re
import sys
import time
import uuid
import warnings
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core import codegen, config, event, sigutils, typing
from numba.core.caching import CompileResultCacheImpl, NullCache
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.core.typed_passes import NopythonRewrites
from numba.core.types import (  # type: ignore[attr-defined]
    BaseTuple,
    NoneType,
    Optional,
    Type,
    unliteral,
)
from numba.core.types import Dispatcher as DispatcherType
from numba.core.untyped_passes import InlineClosureLikes

from stochvi.engine.borrowed import BorrowedTuple
from stochvi.engine.late_exceptions import disturbed, undisturbed
from stochvi.notices import KernelWarning

# ------------------------------------------------------------------------------
# The digest of everything that a kernel is made of.
#
# A kernel on the disk may be used as long as nothing has changed that was compiled into it. This
# module walks from the function of a kernel to all of that:
#
# * the instructions, constants and default values of the function, and what its closure holds;
# * the values of the globals that it names: numbers, tuples and arrays are compiled into it;
# * compiled functions that it calls, in whichever file or package they lie, and so on from there;
# * the functions that numba chooses while it compiles, by the classes of named tuples (`parts`).
#
# Instructions are those in memory, not those in the file: a file may be edited after its import.
# Comments and docstrings are not compiled, and do not enter.
#
# numpy, numba and the standard library are taken by their names. The version of numba stands beside
# the digest.
# ------------------------------------------------------------------------------


LOG = logging.getLogger(__name__)
"""Tells which kernels are compiled."""

BY_NAME = {"numpy", "numba", "llvmlite", "builtins"} | set(sys.stdlib_module_names)
"""Packages whose functions and classes are told by their names."""

MAIN = {"__main__", "__mp_main__"}
"""Names of the module that a process was started with; another process has another one."""


class Ingredients:
    """A walk over what a kernel is made of.

    Parameters
    ----------
    obstacles : reasons, as clauses, for which the digest does not determine the kernel; empty where
        it does.
    running : whether plain functions are met that run as they are, and are no stubs of functions
        that numba compiles.
    """

    def __init__(self, *, running: bool = False) -> None:
        self.obstacles: list[str] = []
        self._told = hashlib.sha256()
        self._met: dict[int, tuple[int, Any]] = {}  # what lives on keeps its `id`
        self._generic: list[Any] = []
        self._classes: list[type] = [object]
        self._running = running
        self._ahead: deque[tuple[FunctionType, dict[str, Any], bool]] = deque()

    def digest(self) -> str:
        """Return the digest of all that was added, with the functions that its classes choose."""
        tried: set[tuple[int, type]] = set()
        while True:
            self._read_functions()
            # a function that is chosen may name further classes and generic functions
            pairs = [
                (generic, kind)
                for generic in self._generic
                for kind in self._classes
                if (id(generic), kind) not in tried
            ]
            if not pairs:
                return self._told.hexdigest()
            for generic, kind in pairs:
                tried.add((id(generic), kind))
                base = next((each for each in kind.__mro__ if each in generic.made_of), None)
                if base is not None:
                    self._tell("chosen", base.__module__, base.__qualname__)
                    chosen = generic.made_of[base]
                    running = isinstance(chosen, tuple)  # these run while numba compiles
                    for function in chosen if running else (chosen,):
                        self._ahead.append((function, function.__globals__, running))

    def add(self, value: Any) -> None:
        """Add a value that a function names."""
        if value is None or isinstance(value, bool | int | float | complex | str | bytes):
            self._tell(type(value).__name__, repr(value))
            return
        if id(value) in self._met:
            self._tell("again", self._met[id(value)][0])
            return
        self._met[id(value)] = (len(self._met), value)
        if isinstance(value, np.ndarray | np.generic) and value.dtype != object:
            self._tell("array", value.dtype, value.shape)
            self._told.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, tuple | list):
            self.add(type(value))
            self._tell(len(value))
            for each in value:
                self.add(each)
        elif isinstance(value, Dispatcher):
            self._tell("dispatcher", sorted(value.targetoptions.items()))
            if value.py_func.__closure__ and not hasattr(value, "obstacles"):
                self._hinder(value, "is a closure that numba.njit compiles; use engine.kernel")
            self.function(value.py_func)
        elif hasattr(value, "made_of"):
            self._tell("generic", value.__module__, value.__qualname__)
            self._generic.append(value)
        elif hasattr(value, "_defn"):  # numba's `intrinsic`, whose functions run while it compiles
            self._ahead.append((value._defn, value._defn.__globals__, True))
        elif isinstance(value, FunctionType):
            if _package(value) in BY_NAME:
                self._tell(value.__module__, value.__qualname__)
            elif self._running:
                self.function(value)
            else:
                self._hinder(value, "does not declare in `made_of` what numba compiles for it")
        elif isinstance(value, type):
            self._class(value)
        elif isinstance(value, ModuleType):
            self._tell("module", value.__name__)
        elif isinstance(value, Enum):
            self._tell(type(value).__module__, str(value))
            self.add(value.value)
        elif _package(value) in BY_NAME and not isinstance(
            value, dict | set | frozenset | np.ndarray
        ):
            text = getattr(value, "__qualname__", getattr(value, "__name__", "")) or repr(value)
            self._tell(type(value).__qualname__, getattr(value, "__module__", ""), text)
            if " at 0x" in text:
                self._hinder(value, "is known by its address only")
        else:
            self._hinder(value, "is of no kind whose contents are known")

    def function(self, function: FunctionType, *, globals: bool = True) -> None:
        """Add the instructions of a function, its closure, and the `globals` that it names."""
        self._ahead.append((function, function.__globals__ if globals else {}, self._running))

    def _read_functions(self) -> None:
        # one after the other: chains of calls are longer than Python's stack should be
        while self._ahead:
            function, names, self._running = self._ahead.popleft()
            self._tell("function", function.__module__, function.__name__)
            if function.__module__ in MAIN:
                self._hinder(function, "is defined in __main__; put it into a module")
            self.add(function.__defaults__)
            for cell in function.__closure__ or ():
                self.add(cell.cell_contents)
            self._code(function.__code__, names, function.__doc__)

    def signature(self, arguments: Iterable[Type]) -> None:
        """Add the types of arguments, and the classes of the named tuples among them."""
        for kind in arguments:
            if isinstance(kind, BaseTuple):
                self._tell("tuple", len(kind))
                self.add(getattr(kind, "instance_class", tuple))
                self.signature(kind)
            elif isinstance(kind, BorrowedTuple):
                self._tell("borrowed")
                self.signature([kind.kind])
            elif isinstance(kind, DispatcherType):
                self.add(kind.dispatcher)
            elif isinstance(kind, Optional):
                self._tell("optional")
                self.signature([kind.type])
            else:
                self._tell(str(kind))
                if isinstance(kind, NoneType):
                    self._classes.append(type(None))
                if " at 0x" in str(kind):
                    self.obstacles.append(f"an argument is known by its address only: {kind}")

    def _code(self, code: CodeType, names: dict[str, Any], docstring: str | None) -> None:
        self._tell(
            code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars,
            code.co_cellvars, code.co_argcount, code.co_kwonlyargcount, code.co_flags,
        )  # fmt: skip
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                self._code(constant, names, None)
            elif constant is None or constant != docstring:
                self._tell(type(constant).__name__, repr(constant))
        for name in code.co_names:
            if name not in names:
                continue  # an attribute, or a function of Python
            self._tell(name)
            self.add(names[name])
            if isinstance(names[name], ModuleType) and _package(names[name]) not in BY_NAME:
                for attribute in code.co_names:
                    if hasattr(names[name], attribute):
                        self.add(getattr(names[name], attribute))

    def _class(self, kind: type) -> None:
        self._tell("class", kind.__module__, kind.__qualname__)
        if _package(kind) in BY_NAME:
            return
        if kind.__module__ in MAIN:
            self._hinder(kind, "is defined in __main__; put it into a module")
        fields = getattr(kind, "_fields", None)
        if issubclass(kind, tuple) and fields is not None:
            self._tell(fields)
            self.add(tuple(getattr(kind, "_field_defaults", {}).values()))
            self._classes.append(kind)
        elif issubclass(kind, Enum):
            self.add(tuple(each.value for each in kind))
        elif self._running:  # a type of numba
            for each in vars(kind).values():
                if isinstance(each, FunctionType):
                    self.function(each)
        else:
            self._hinder(kind, "is no class of named tuples")

    def _hinder(self, value: Any, what: str) -> None:
        name = getattr(value, "__name__", None) or f"a value of type {type(value).__name__}"
        self.obstacles.append(f"{name} {what}")

    def _tell(self, *words: Any) -> None:
        self._told.update("\0".join(map(str, words)).encode() + b"\n")


def _package(value: Any) -> str:
    """Name of the package that a module, function or class lies in, or that made an object."""
    if isinstance(value, ModuleType):
        name = value.__name__
    else:
        name = getattr(value, "__module__", None) or type(value).__module__
    return str(name).partition(".")[0]


# ------------------------------------------------------------------------------
# How kernels are compiled, and kept on the disk.
#
# `@kernel` stands before every compiled function of the package, and before the helper functions of
# users' own parts:
#
#     @kernel
#     def energy(mass, speed):
#         return 0.5 * mass * speed**2
#
# It is `numba.njit` with the error model of numpy and without the global lock of Python. Its rule
# for the machine code on the disk is another.
#
# **What a kernel on the disk is known by.** numba looks at the file of a function alone, although
# the functions that it calls and the values of its globals are compiled into it. A kernel is
# therefore kept under the digest of everything that it is made of (`Ingredients`), in whichever
# files that lies. After a change of any of it the kernel is compiled again. Nothing has to be
# declared for what a kernel names: compiled functions, also from a closure, numbers, tuples,
# arrays, and classes of named tuples.
#
# **What is optimised.** numba optimises a function, makes machine code of it, and does so again in
# each of its callers: the time that this takes rises with the depth of calls. Here a function that
# kernels call is a `LinkedKernel`, which is only linked. A kernel that Python calls is optimised as
# a whole, once. A linked kernel is compiled once for all numbers of a type. numba would compile it
# once more for each number that stands in a call.
#
# **What compiles fast.** A function costs some 20 ms of CPU time, however short it is. Write small
# views and casts by `type_callable` and `lower_builtin`, as `engine/arithmetic.py` does, not by
# `overload`. Write loops for `a[:] = b` and `a += b`, for which numba compiles the texts of errors
# (1 s). Hand on large named tuples by `borrowed`, from Python by `lent`: a call then takes one
# address in place of hundreds of numbers. Make arrays in Python. What few scenes need is called by
# `calls.call_apart`. Functions of numbers take `forceinline=True`. `inline="always"` repeats their
# passes in each caller; it is for loops over lanes that gain from it.
#
# **How a kernel composed of parts declares what it is made of.** A generic function of `parts`
# holds its bodies by class, in its dictionary `made_of`. The digest takes the bodies for the
# classes of the arguments of a kernel, for the classes that these name, and for `object`, and no
# others: a law that is not in a kernel does not have it compiled again. A function that numba
# compiles by other means (`overload`, `type_callable` with `lower_builtin`) declares the same by
# hand:
#
#     fma.made_of = {object: (type_of_fma, write_fma)}
#
# **What is not kept.** A kernel is compiled anew in each process where the digest would not
# determine it, for instance where a part is defined in `__main__`. `Kernel.obstacles` says why, so
# that an answer can say so.
#
# **Where.** The places are numba's own: the folder NUMBA_CACHE_DIR where that is set, else
# `__pycache__` beside the kernel, else, where that cannot be written, a folder of the user. A file
# holds one kernel for one signature. A file that cannot be read is removed, and the kernel is
# compiled again.
#
# **Which process.** Processes that start together need the same kernels. One of them compiles a
# kernel while the others wait, and then they load it. While a process waits, it sends numba's
# events "stochvi:wait" and, before each attempt, "stochvi:look"; a listener may end the waiting by
# an exception.
# ------------------------------------------------------------------------------


try:
    import fcntl
except ImportError:  # Windows has no such locks: there every process compiles what it needs
    fcntl = None  # type: ignore[assignment]

USED = {
    codegen.JITCodeLibrary: ("add_linking_library", "_get_module_for_linking"),
    CPUDispatcher: (
        "_compilation_chain_init_hook",
        "add_overload",
        "compile",
        "get_call_template",
        "get_overload",
    ),
    Compiler: ("compile_extra", "define_pipelines"),
    Flags: ("copy", "values"),
    CompileResultCacheImpl: ("check_cachable", "locator", "rebuild", "reduce"),
}
"""Parts of numba that kernels use beside those that it documents."""

for _kind, _names in USED.items():
    if _lacking := [name for name in _names if not hasattr(_kind, name)]:
        raise ImportError(
            f"numba {numba.__version__} has no {_kind.__name__}.{_lacking[0]}, which kernels use; "
            "install a version from 0.60 to 0.68"
        )

PATIENCE = 120.0
"""Longest wait, s, for another process that compiles the same kernel: several times what the
largest kernel takes. A process that has waited so long compiles the kernel itself, because the
other one may have been suspended."""

BETWEEN_ATTEMPTS = 0.02
"""Time, s, between two attempts to get a lock that another process has."""

KEPT = 8
"""Number of files that are kept of a kernel for one signature: those of the last versions of its
parts, so that nobody compiles again who goes to and fro between two of them."""

NEW_OBJECTS, NO_FULL_COLLECTION = 100_000, 1_000_000
"""Thresholds of Python's search for cycles of objects while a kernel is compiled: it looks among so
many new objects, and at all objects never."""


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """A compiled function; see the beginning of this chapter.

    Parameters
    ----------
    obstacles : reasons, as clauses, for which compiled versions of this process are not kept.
    """

    def __init__(self, py_func: Any, *arguments: Any, **options: Any) -> None:
        super().__init__(py_func, *arguments, **options)
        self.obstacles: list[str] = []
        self._cache = KernelCache(self)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the compiled function; exceptions of signals and other threads wait for its end."""
        return undisturbed(super().__call__, arguments, named)

    @cached_property
    def linked(self) -> LinkedKernel:
        """The function as other kernels call it."""
        return LinkedKernel(self)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile the function for a call from another kernel, once for all numbers of a type."""
        of_types = tuple(map(unliteral, args))
        return self.linked.get_call_template(
            of_types, {name: unliteral(each) for name, each in kws.items()}
        )

    def get_overload(self, sig: Any) -> Any:
        """The function for a call from another kernel."""
        return self.linked.get_overload(sig)

    def add_overload(self, cres: Any) -> None:
        """Add a compiled version, with the environments of the kernels linked into it."""
        for environment in cres._find_referenced_environments():
            cres.library.codegen.set_env(environment.env_name, environment)
        super().add_overload(cres)

    def compile(self, sig: Any) -> Any:
        """Compile the kernel for a signature or load it, while other processes wait for it."""
        arguments = tuple(sigutils.normalize_signature(sig)[0])
        # the lock of this process comes first: a thread that waits for it holds up no other process
        with disturbed(), global_compiler_lock:
            if arguments in self.overloads or not self._can_compile:
                return super().compile(sig)
            file = self._cache.find(sig, arguments)
            with in_turn(file), self._named_by(file), seldom_collected():
                return super().compile(sig)

    def enable_caching(self) -> None:
        """Kernels are always kept."""

    def _compilation_chain_init_hook(self) -> None:
        """Look for extensions of numba when a kernel is compiled, not when it is loaded."""

    @contextmanager
    def _named_by(self, file: Path | None) -> Iterator[None]:
        """Compile a closure under a name that its contents determine.

        Machine code is linked by names, and numba numbers the functions of each process from 1. Two
        closures of different contents, compiled by two processes and loaded by a third, could have
        one name; both would then be the one that was loaded first.
        """
        function = self.py_func
        name = function.__qualname__
        if function.__closure__ and file:
            function.__qualname__ = f"{name}_{file.stem[-16:]}"
        try:
            yield
        finally:
            function.__qualname__ = name

    def __reduce__(self) -> Any:
        """Let a kernel travel to another process by its name, where it has one."""
        if "<locals>" in self.__qualname__ or self.__module__ == "__main__":
            return super().__reduce__()
        return _kernel_of, (self.__module__, self.__qualname__)


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Let Python seldom look for cycles of objects meanwhile.

    numba makes millions of objects that live until a kernel is compiled. To look through all of
    them again and again takes an eighth of the time.
    """
    usual = gc.get_threshold()
    gc.set_threshold(usual[0] and max(usual[0], NEW_OBJECTS), usual[1], NO_FULL_COLLECTION)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


class SettledFlags(Flags):  # type: ignore[misc]
    """Options of a compilation, to be compared with others.

    numba does so in each call of a function that it finds by `overload`, and asks for all of them
    by their names each time: a twelfth of the time. What it compares is a copy that nothing changes
    any more.
    """

    __slots__ = ("_found",)

    def __init__(self, given: Flags) -> None:
        super().__init__(given)
        self._found = super().values()

    def values(self) -> Any:
        """Return the value of each option by its name."""
        return self._found


class ComparedFlags(Flags):  # type: ignore[misc]
    """Options of a compilation whose copies are settled."""

    def copy(self) -> SettledFlags:
        """Return a copy that is not changed."""
        return SettledFlags(self)


class LinkedCode(codegen.JITCodeLibrary):  # type: ignore[misc]
    """The code of a kernel before it is optimised, with that of the kernels linked into it."""

    def finalize(self) -> None:
        """Link what the kernel calls."""
        for library in dict.fromkeys(self._linking_libraries):
            if hasattr(library, "_reload_init"):  # numba 0.60 has none
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """No address: nothing but another kernel calls this code."""
        return 0

    @property
    def codegen(self) -> LinkedCode:
        """What sets the environment: none is set before the code is in another kernel."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Leave the environment to the other kernel."""

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """The code for a file."""
        return self.name, self._get_module_for_linking().as_bitcode()

    def of_module(self, module: Any) -> None:
        """Take the code of a module as it is."""
        self._final_module = module
        self._finalized = True


class LinkingCompiler(Compiler):  # type: ignore[misc]
    """Compiles a function to `LinkedCode`, without wrappers for calls from elsewhere.

    Passes that look for closures and for expressions of whole arrays take a fifteenth of the time.
    The first are left out of a function that holds no other one, the second of all: such an
    expression is then made operation by operation.
    """

    def define_pipelines(self) -> Any:
        """Return the passes."""
        found, code = super().define_pipelines(), self.state.func_id.code
        left_out = {NopythonRewrites}
        if not any(isinstance(each, CodeType) for each in code.co_consts):
            left_out.add(InlineClosureLikes)
        for pipeline in found:
            pipeline.passes = [each for each in pipeline.passes if each[0] not in left_out]
        return found

    def compile_extra(self, func: Any) -> Any:
        """Compile a function."""
        state = self.state
        state.flags = ComparedFlags(state.flags)
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = True
        state.library = LinkedCode(state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class LinkedKernel(Kernel):
    """A kernel as other kernels call it: code that is linked into them, and cannot run alone."""

    def __init__(self, owner: Kernel) -> None:
        super().__init__(
            owner.py_func, targetoptions=owner.targetoptions, pipeline_class=LinkingCompiler
        )
        self.obstacles = owner.obstacles

    get_call_template = CPUDispatcher.get_call_template
    get_overload = CPUDispatcher.get_overload
    add_overload = CPUDispatcher.add_overload


class LinkingContext:
    """What numba makes `LinkedCode` with from a file, in place of its own context."""

    def __init__(self, context: Any) -> None:
        self.typing_context = context.typing_context
        self.get_executable = context.get_executable
        self._codegen = context.codegen()

    def codegen(self) -> LinkingContext:
        """What turns the contents of a file into code."""
        return self

    def unserialize_library(self, data: tuple[str, bytes]) -> LinkedCode:
        """The code from a file."""
        name, code = data
        library = LinkedCode(self._codegen, name)
        library.of_module(codegen.ll.parse_bitcode(code))
        return library


def _kernel_of(module: str, name: str) -> Any:
    return getattr(import_module(module), name)


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function as a `Kernel`; `options` are those of `numba.njit`."""
    if function is None:
        return lambda given: kernel(given, **options)
    if config.DISABLE_JIT:
        _say_uncompiled()
        return function
    usual = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True}
    return Kernel(function, targetoptions=usual | options)


@cache
def _say_uncompiled() -> None:
    """Warn, once, that nothing is compiled."""
    warnings.warn(
        "NUMBA_DISABLE_JIT is set: kernels are not compiled, take a hundred times as long, and "
        "give other last digits than compiled ones; unset it",
        KernelWarning,
        stacklevel=3,
    )


class KernelCache(NullCache):  # type: ignore[misc]
    """The files of a kernel on the disk: what `Kernel` asks before it compiles, and tells after."""

    def __init__(self, owner: Kernel) -> None:
        self._owner = owner
        self._files: dict[Any, Path | None] = {}

    @cached_property
    def _means(self) -> CompileResultCacheImpl | None:
        """numba's means to find a folder and to take machine code apart; None without a folder."""
        try:
            return CompileResultCacheImpl(self._owner.py_func)
        except (RuntimeError, OSError):
            return None

    @property
    def cache_path(self) -> str | None:
        """The folder of the files."""
        return self._means and self._means.locator.get_cache_path()

    def find(self, sig: Any, arguments: tuple[Any, ...]) -> Path | None:
        """Return the file for a signature, which need not exist; None where it is not kept."""
        made_of = Ingredients()
        made_of.add(self._owner)
        made_of.signature(arguments)
        target = self._owner.targetctx
        of_machine = (
            numba.__version__, sys.implementation.cache_tag, target.codegen().magic_tuple(),
            config.OPT, config.BOUNDSCHECK, config.LOOP_VECTORIZE, config.SLP_VECTORIZE,
        )  # fmt: skip
        digest = hashlib.sha256(f"{made_of.digest()} {of_machine}".encode()).hexdigest()
        obstacles = made_of.obstacles
        if not obstacles and self._means is None:
            obstacles = [f"{self._owner.__name__} has no folder that can be written"]
        self._owner.obstacles += [each for each in obstacles if each not in self._owner.obstacles]
        if obstacles:
            self._files[sig] = None
        else:
            types = re.sub(" at 0x[0-9a-f]+", "", str(arguments))
            types = hashlib.sha256(types.encode()).hexdigest()[:8]
            function = self._owner.py_func
            name = f"{function.__module__.rpartition('.')[2]}.{function.__qualname__}"
            name += "-linked" * isinstance(self._owner, LinkedKernel)
            name = "".join(letter for letter in name if letter not in "<>")
            self._files[sig] = Path(self.cache_path or "", f"{name}-{types}-{digest[:32]}.nbc")
        return self._files[sig]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled version of a signature, or None where no file holds it."""
        file = self._files.get(sig)
        if file is None or self._means is None:
            return None
        try:
            data = file.read_bytes()
        except OSError:
            return None
        try:
            if hashlib.sha256(data[32:]).digest() != data[:32]:
                raise ValueError("the file is damaged")
            # what numba prepares beside this for a context, only a compilation needs
            rtsys.initialize(target_context)
            if isinstance(self._owner, LinkedKernel):
                target_context = LinkingContext(target_context)
            found = self._means.rebuild(target_context, pickle.loads(data[32:]))
        except Exception:  # written by another version, perhaps: anything may be raised
            with suppress(OSError):
                file.unlink()
            return None
        # types of functions are equal only to those of this process
        arguments, _ = sigutils.normalize_signature(sig)
        return found._replace(signature=typing.signature(found.signature.return_type, *arguments))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled version; where the folder cannot be written, do without."""
        LOG.debug("compiled %s", self._owner.py_func.__qualname__)
        file = self._files.get(sig)
        if file is None or self._means is None or not self._means.check_cachable(data):
            return
        content = dumps(self._means.reduce(data))
        part = file.with_name(f"{file.name}.tmp.{uuid.uuid4().hex[:16]}")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(hashlib.sha256(content).digest() + content)
            os.replace(part, file)
            self._forget(file.name.rpartition("-")[0], file.parent)
        except OSError:
            with suppress(OSError):
                part.unlink()

    def flush(self) -> None:
        """Remove the files of the signatures that this process has asked for."""
        for file in filter(None, self._files.values()):
            file.unlink(missing_ok=True)

    @staticmethod
    def _forget(kernel: str, folder: Path) -> None:
        """Remove all but the newest files of a kernel for one signature."""
        files = [each for each in folder.iterdir() if each.name.rpartition("-")[0] == kernel]
        for old in sorted(files, key=lambda each: each.stat().st_mtime)[:-KEPT]:
            old.unlink(missing_ok=True)


@cache
def _lock_file(folder: Path) -> int | None:
    """Descriptor of the file of locks of a folder, or None where there are no locks.

    The locks lie on bytes beyond its end. The system takes them back when a process ends, however
    it ends, and a process never waits for itself.
    """
    if fcntl is None:
        return None
    with suppress(OSError):
        return os.open(folder / "kernels.lock", os.O_RDWR | os.O_CREAT, 0o666)
    return None


def _locked(file: int, byte: int) -> bool | None:
    """Whether this process has the lock now; None in a file system without locks."""
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return None
    return True


@contextmanager
def in_turn(kept: Path | None) -> Iterator[None]:
    """Let other processes wait that need the same file, unless it is there already."""
    lock = None if kept is None or kept.exists() else _lock_file(kept.parent)
    if kept is None or lock is None:
        yield
        return
    byte = zlib.crc32(kept.name.encode())
    if _locked(lock, byte) is False:  # another process has it
        end = time.monotonic() + PATIENCE
        with event.trigger_event("stochvi:wait"):
            while _locked(lock, byte) is False and time.monotonic() < end:
                event.broadcast(event.Event("stochvi:look", event.EventStatus.START))
                time.sleep(BETWEEN_ATTEMPTS)
    try:
        yield
    finally:
        with suppress(OSError):
            fcntl.lockf(lock, fcntl.LOCK_UN, 1, byte)
