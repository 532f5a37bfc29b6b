"""Functions that numba chooses, while it compiles, by the class of their first argument.

A kernel calls a generic function. A part is a class of named tuples that has a function of its own
for it:

    @generic
    def rebound(law, speed):
        "Speed after an impact, m/s."

    class Constant(NamedTuple):
        restitution: float

    @rebound.of(Constant)
    def _(law, speed):
        return law.restitution * speed

What a kernel calls is settled when it is compiled: neither a branch nor a pointer is left in it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import update_wrapper
from types import FunctionType
from typing import Any, cast

from numba.core.types import NoneType  # type: ignore[attr-defined]
from numba.extending import overload

from stochvi.engine.compiling import LinkingCompiler
from stochvi.engine.ingredients import Ingredients


class Generic:
    """A function whose body is chosen by the class of its first argument, or by a base of it.

    The body for `object` serves every class without one of its own, and the body for `NoneType`
    stands for an absent part. Without compilation the function chooses at each call.

    Parameters
    ----------
    stub : function with the name, the arguments and the docstring. It is never called.
    inline : whether the bodies are put into the kernels that call them. Only large bodies that are
        called seldom gain by staying apart.
    """

    def __init__(self, stub: Callable[..., Any], inline: bool = True) -> None:
        update_wrapper(self, stub)
        self._name = stub.__name__
        self.made_of: dict[type, Callable[..., Any]] = {}
        self._arguments = list(inspect.signature(stub).parameters)

        def choose(part: Any, *others: Any) -> Callable[..., Any] | None:
            if isinstance(part, NoneType):
                return self.body(type(None))
            return self.body(getattr(part, "instance_class", object))

        options = {"error_model": "numpy", "forceinline": inline, "pipeline_class": LinkingCompiler}
        overload(self, jit_options=options, strict=False)(choose)

    def of(self, *kinds: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        """Return a decorator that makes a function the body for these classes.

        Raises
        ------
        TypeError
            If the arguments of the body have other names: numba passes them by name.
        """

        def keep(body: Callable[..., Any]) -> Callable[..., Any]:
            arguments = list(inspect.signature(body).parameters)
            if arguments != self._arguments:
                raise TypeError(
                    f"a body of {self._name} must have the arguments {self._arguments}, got "
                    f"{arguments}; rename them"
                )
            for kind in kinds:
                self.made_of[kind] = body
            # Machine code is linked by names, also across kernels that are loaded from the disk.
            contents = Ingredients()
            contents.function(cast(FunctionType, body), globals=False)
            body.__qualname__ = f"{self._name}_{kinds[0].__qualname__}_{contents.digest()[:16]}"
            return body

        return keep

    def body(self, kind: type) -> Callable[..., Any] | None:
        """Return the function that serves a class, or None where there is none."""
        return next((self.made_of[each] for each in kind.__mro__ if each in self.made_of), None)

    def __call__(self, *arguments: Any) -> Any:
        """Call the body for the class of the first argument, without compiling it."""
        body = self.body(type(arguments[0]))
        if body is None:
            raise NotImplementedError(
                f"{self._name} must have a body for {type(arguments[0]).__name__}; write one "
                f"under @{self._name}.of({type(arguments[0]).__name__})"
            )
        return body(*arguments)


def generic(stub: Callable[..., Any] | None = None, *, inline: bool = True) -> Any:
    """Make a function generic; see `Generic`."""
    if stub is None:
        return lambda function: Generic(function, inline)
    return Generic(stub, inline)
