"""Functions that numba chooses by the class of their first argument. Chapters: the choice
(`generic`); what a kernel asks of the law of a stop; what it asks of a spring or damper that is a
function."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from functools import update_wrapper
from types import FunctionType
from typing import Any, NamedTuple, cast

from numba.core.types import NoneType  # type: ignore[attr-defined]
from numba.extending import overload

from stochvi.engine.compiling import Ingredients, LinkingCompiler

# ------------------------------------------------------------------------------
# Functions that numba chooses, while it compiles, by the class of their first argument.
#
# A kernel calls a generic function. A part is a class of named tuples that has a function of its
# own for it:
#
#     @generic
#     def rebound(law, speed):
#         "Speed after an impact, m/s."
#
#     class Constant(NamedTuple):
#         restitution: float
#
#     @rebound.of(Constant)
#     def _(law, speed):
#         return law.restitution * speed
#
# What a kernel calls is settled when it is compiled: neither a branch nor a pointer is left in it.
# ------------------------------------------------------------------------------


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
            contents.function(cast("FunctionType", body), globals=False)
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


# ------------------------------------------------------------------------------
# What a kernel asks of the law of a stop.
#
# A law is a class of named tuples of numbers, for forces per unit mass. It has one of two
# functions:
#
#     rebound(law, w, uniform)     rigid: speed after an impact at the speed w
#     force(law, y, v)            compliant: force at the deflection y and its rate v
#
# The other functions say how a contact is followed; they have bodies that serve most laws.
#
# A law is known to a kernel by the numbers of its stop, a row of a table, from which `read_law`
# makes it. `calls` compiles the functions of a class on their own, so that a kernel serves all
# laws.
# ------------------------------------------------------------------------------


MOST_NUMBERS = 4
"""Largest number of numbers of a law that are kept beside a lane. A law with more reads the table,
whose row is kept as well."""


@generic
def rebound(law, w, uniform):
    """Speed after an impact at the speed w, m/s; `uniform` is a uniform number of that impact."""


@generic
def mean_rebound(law, w):
    """Mean speed after impacts at the speed w, m/s."""


@generic
def force(law, y, v):
    """Force of a stop that pushes, m/s^2, at the deflection y > 0 (m) and its rate v (m/s)."""


@generic
def margin(law, y, v):
    """Deflection, m, that is left until the stop no longer pushes; linear in y and v."""


@generic
def rate(law, y, v, push):
    """Largest rate (rad/s) in a contact that is at y and v, with the acceleration `push` onto the
    stop: that of its oscillation or of its damping."""


@generic
def energy(law, y):
    """Energy that a stop without losses holds at the deflection y, m^2/s^2; nan where nobody has
    said."""


@generic
def is_rigid(law):
    """Whether the stop is rigid."""


@generic
def is_lossy(law):
    """Whether a contact takes energy."""


@generic
def is_smooth(law):
    """Whether the force has derivatives where the contact begins."""


@generic
def read_law(law, numbers, row):
    """The law of this class whose numbers are a row of a table."""


@generic
def read_lane(law, lanes, lane, numbers):
    """The law of this class of a lane, from its numbers or from the table.

    `lanes` (lanes, MOST_NUMBERS + 1) holds the first numbers of each lane, and its row of the table
    `numbers`.
    """


@read_lane.of(object)
def _(law, lanes, lane, numbers):
    return read_law(law, lanes, lane)


@margin.of(object)
def _(law, y, v):
    return y


@rebound.of(object)
def _(law, w, uniform):
    return 0.0


@mean_rebound.of(object)
def _(law, w):
    return rebound(law, w, 0.5)


@force.of(object)
def _(law, y, v):
    return 0.0


@rate.of(object)
def _(law, y, v, push):
    return 0.0


@energy.of(object)
def _(law, y):
    return math.nan


@is_rigid.of(object)
def _(law):
    return False


@is_lossy.of(object)
def _(law):
    return False


@is_smooth.of(object)
def _(law):
    return True


def bodies_lacking(law: Any) -> list[str]:
    """Names of the functions that a class of laws must have bodies for, and has none."""
    asked = (rebound, read_law) if is_rigid(law) else (force, rate, read_law)
    kind = type(law)
    return [each.__name__ for each in asked if each.body(kind) in (None, each.made_of.get(object))]


# ------------------------------------------------------------------------------
# What a kernel asks of a spring or damper that is a function.
#
# A characteristic is a class of named tuples of numbers, for forces per unit mass. It has one body
# of its own, and others where the defaults are wrong:
#
#     pull(part, x, v, z)    force against the displacement x at the rate v, with the memory z
#
# A kick changes the rate v while x stays: v' = k x + c v + f - pull. The affine force is in the
# flow of the linear structure, and a kick takes it out again. `kicked` solves this equation; by
# default v does not enter the force. A part whose force depends on v says so by `damps`.
#
# A force with hysteresis has a memory z that changes with x alone, by `moved`, whose rate is
# `slope`. What sees the motion in time changes its memory in each kick, by `watched`, before it
# acts.
# ------------------------------------------------------------------------------


class Affine(NamedTuple):
    """The force k x + c v + f per unit mass that the linear structure holds in the place of a part.

    Parameters
    ----------
    stiffness, damping, force : k, 1/s^2, c, 1/s, and f, m/s^2.
    """

    stiffness: float
    damping: float
    force: float


@generic
def pull(part, x, v, z):
    """Force per unit mass, m/s^2, at the displacement x (m) and the rate v (m/s)."""


@generic
def damps(part):
    """Whether the force depends on the rate."""


@generic
def kicked(part, x, v, z, push, damping, h):
    """Rate, m/s, after the time h (s) of v' = push + damping v - pull at a fixed displacement."""


@generic
def remembers(part):
    """Whether the force depends on a memory."""


@generic
def moved(part, z, way):
    """Memory after the displacement has changed by `way` (m), in one direction."""


@generic
def slope(part, z, way):
    """Slope of the memory over the displacement, 1/m, in the direction of `way`."""


@generic
def watched(part, x, v, z, h):
    """Memory in a kick of the time h (s), at the displacement x and the rate v."""


@generic
def read_characteristic(part, numbers, row):
    """The part of this class whose numbers are a row of a table."""


@damps.of(object)
def _(part):
    return False


@remembers.of(object)
def _(part):
    return False


@moved.of(object)
def _(part, z, way):
    return z


@slope.of(object)
def _(part, z, way):
    return 0.0


@watched.of(object)
def _(part, x, v, z, h):
    return z


@kicked.of(object)
def _(part, x, v, z, push, damping, h):
    if not damps(part):
        # the exponential of the linear damper by its series: damping h is small against 1
        growth = h * (1.0 + damping * h / 2.0 * (1.0 + damping * h / 3.0))
        return v + growth * (push + damping * v - pull(part, x, 0.0, z))
    # the classical method of Runge and Kutta, as nothing is known of the force
    a = push + damping * v - pull(part, x, v, z)
    b = push + damping * (v + 0.5 * h * a) - pull(part, x, v + 0.5 * h * a, z)
    c = push + damping * (v + 0.5 * h * b) - pull(part, x, v + 0.5 * h * b, z)
    d = push + damping * (v + h * c) - pull(part, x, v + h * c, z)
    return v + h * (a + 2.0 * b + 2.0 * c + d) / 6.0
