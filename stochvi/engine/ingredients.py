"""The digest of everything that a kernel is made of.

A kernel on the disk may be used as long as nothing has changed that was compiled into it. This
module walks from the function of a kernel to all of that:

* the instructions, constants and default values of the function, and what its closure holds;
* the values of the globals that it names: numbers, tuples and arrays are compiled into it;
* compiled functions that it calls, in whichever file or package they lie, and so on from there;
* the functions that numba chooses while it compiles, by the classes of named tuples (`parts`).

Instructions are those in memory, not those in the file: a file may be edited after its import.
Comments and docstrings are not compiled, and do not enter.

numpy, numba and the standard library are taken by their names. The version of numba stands beside
the digest.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable
from enum import Enum
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher
from numba.core.types import BaseTuple, NoneType, Optional, Type  # type: ignore[attr-defined]
from numba.core.types import Dispatcher as DispatcherType

from stochvi.engine.borrowed import BorrowedTuple

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

    def digest(self) -> str:
        """Return the digest of all that was added, with the functions that its classes choose."""
        tried: set[tuple[int, type]] = set()
        while True:
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
                    running = self._running
                    self._running = isinstance(chosen, tuple)  # these run while numba compiles
                    for function in chosen if self._running else (chosen,):
                        self.function(function)
                    self._running = running

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
            running, self._running = self._running, True
            self.function(value._defn)
            self._running = running
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
        self._tell("function", function.__module__, function.__name__)
        if function.__module__ in MAIN:
            self._hinder(function, "is defined in __main__; put it into a module")
        self.add(function.__defaults__)
        for cell in function.__closure__ or ():
            self.add(cell.cell_contents)
        self._code(function.__code__, function.__globals__ if globals else {}, function.__doc__)

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
