"""Arrays of which kernels count no owners, and tuples that are handed on by their address.

numba counts the owners of an array by an atomic number. It changes each time that a kernel names
the array or hands on a tuple with it. In a loop over single paths the counting takes longer than
the loop. A borrowed array is the same array without an owner: nothing is counted, and another
variable must keep the array until it is no longer used:

    room = np.zeros(10)
    fill(borrowed(room))
    hold(room)

A named tuple is otherwise handed on as all its numbers, of which an array has ten, and each call
writes them anew. A borrowed one is an address. Only its members can be read, by their names, and it
must not be returned: it ends with the function that borrowed it. It is read before a loop over
lanes: in the loop, what it holds might have changed for all that the compiler knows.

numba takes apart what Python hands to a kernel, by code for each array that takes long to compile.
A tuple that is `lent` is an address here as well:

    kernel(lent(room))
"""

from __future__ import annotations

import ctypes
import hashlib
import struct
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numba import typeof
from numba.core import cgutils, config, types
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_cast,
    register_model,
    type_callable,
    unbox,
)

Given = TypeVar("Given")


class BorrowedArray(types.Array):  # type: ignore[misc, name-defined]
    """The type of an array without an owner."""

    def __init__(self, dtype, ndim, layout, readonly=False):  # type: ignore[no-untyped-def]
        name = f"borrowed({dtype}, {ndim}d, {layout}, {'readonly' if readonly else 'mutable'})"
        super().__init__(dtype, ndim, layout, readonly=readonly, name=name)


@register_model(BorrowedArray)
class BorrowedModel(models.StructModel):  # type: ignore[misc]
    """The members of an array, with a plain pointer in the place of the counter."""

    def __init__(self, dmm, fe_type):  # type: ignore[no-untyped-def]
        numbers = types.UniTuple(types.intp, fe_type.ndim)
        members = [
            ("meminfo", types.voidptr), ("parent", types.pyobject), ("nitems", types.intp),
            ("itemsize", types.intp), ("data", types.CPointer(fe_type.dtype)),
            ("shape", numbers), ("strides", numbers),
        ]  # fmt: skip
        super().__init__(dmm, fe_type, members)

    def traverse(self, builder):
        """Nothing: no member is counted, which spares code that takes the array apart."""
        return []


@lower_cast(BorrowedArray, types.Array)
def _as_array(context, builder, given, wanted, value):
    """An array with the counter 0, for functions with a signature of their own."""
    return value


class BorrowedTuple(types.Type):  # type: ignore[misc, name-defined]
    """The type of the address of a named tuple whose arrays are borrowed."""

    def __init__(self, kind):  # type: ignore[no-untyped-def]
        self.kind, self.instance_class = kind, kind.instance_class
        # names of functions are made of those of types, and written wherever these are called
        digest = hashlib.sha256(str(kind).encode()).hexdigest()[:16]
        super().__init__(name=f"borrowed({kind.instance_class.__name__}, {digest})")

    @property
    def key(self):
        """What tells two types apart."""
        return self.kind

    def member(self, name):
        """Number and type of a member."""
        number = self.kind.fields.index(name)
        return number, self.kind[number]


@register_model(BorrowedTuple)
class BorrowedTupleModel(models.PrimitiveModel):
    """An address."""

    def __init__(self, dmm, fe_type):  # type: ignore[no-untyped-def]
        super().__init__(dmm, fe_type, dmm.lookup(fe_type.kind).get_value_type().as_pointer())


@infer_getattr
class BorrowedMembers(AttributeTemplate):
    """The types of the members of a borrowed tuple."""

    key = BorrowedTuple

    def generic_resolve(self, borrowed, name):
        if name not in borrowed.kind.fields:
            return None
        return type_when_borrowed(borrowed.member(name)[1])


@lower_getattr_generic(BorrowedTuple)
def read_member(context, builder, kind, value, name):
    """A member, or the address of one that is a named tuple."""
    number, member = kind.member(name)
    place = cgutils.gep_inbounds(builder, value, 0, number)
    return place if isinstance(member, types.BaseNamedTuple) else builder.load(place)


def borrowed(value: Given) -> Given:
    """An array without its owner, or the address of a named tuple of such arrays; other values as
    they are."""
    return value


def hold(value: object) -> None:
    """Keep an array, or the arrays of a tuple, until here."""


def type_when_borrowed(kind):
    """The type of a borrowed value of a type."""
    ownerless = _ownerless(kind)
    return BorrowedTuple(ownerless) if isinstance(kind, types.BaseNamedTuple) else ownerless


def _ownerless(kind):
    """A type in which no owners are counted."""
    if isinstance(kind, BorrowedArray):
        return kind
    if isinstance(kind, types.Array):
        return BorrowedArray(kind.dtype, kind.ndim, kind.layout, not kind.mutable)
    if isinstance(kind, types.BaseNamedTuple):
        return types.NamedTuple([_ownerless(each) for each in kind], kind.instance_class)
    if isinstance(kind, types.BaseTuple):
        return types.Tuple([_ownerless(each) for each in kind])
    return kind


def _value_of(context, builder, kind, value):
    """A value of a type without the owners of its arrays."""
    if isinstance(kind, types.Array) and not isinstance(kind, BorrowedArray):
        old = context.make_array(kind)(context, builder, value=value)
        new = context.make_array(_ownerless(kind))(context, builder)
        for name in ("nitems", "itemsize", "data", "shape", "strides"):
            setattr(new, name, getattr(old, name))
        new.meminfo = context.get_constant_null(types.voidptr)
        new.parent = context.get_constant_null(types.pyobject)
        return new._getvalue()
    if isinstance(kind, types.BaseTuple):
        values = [
            _value_of(context, builder, each, builder.extract_value(value, k))
            for k, each in enumerate(kind)
        ]
        return context.make_tuple(builder, _ownerless(kind), values)
    if context.enable_nrt:
        context.nrt.incref(builder, kind, value)  # what is returned has an owner
    return value


class Lent:
    """A named tuple as kernels know a borrowed one, which this keeps."""

    def __init__(self, value: tuple[Any, ...]) -> None:
        self._value = value
        self._numba_type_, self._format = described(value)

    @cached_property
    def _memory(self) -> Any:
        """The tuple as compiled code holds it."""
        numbers: list[Any] = []
        _lay_out(self._value, numbers)
        return ctypes.create_string_buffer(self._format.pack(*numbers))

    @property
    def address(self) -> int:
        """The address, for as long as this lives."""
        return ctypes.addressof(self._memory)

    def __reduce__(self) -> Any:
        """Let the tuple travel to another process, where it has another address."""
        return Lent, (self._value,)


def lent(value: Given) -> Given:
    """A named tuple for a kernel, which gets its address; None, and any value where nothing is
    compiled, as it is."""
    if value is None or config.DISABLE_JIT:
        return value
    return Lent(value)  # type: ignore[return-value, arg-type]


_DESCRIBED: dict[Any, tuple[Any, struct.Struct]] = {}
"""What `described` returns, which numba takes milliseconds to find, by `_class_of` the value."""


def described(value: Any) -> tuple[Any, struct.Struct]:
    """The type of a value when it is borrowed, and the format of its numbers in compiled code."""
    key = _class_of(value)
    if key not in _DESCRIBED:
        kind = type_when_borrowed(typeof(value))  # type: ignore[no-untyped-call]
        _DESCRIBED[key] = kind, struct.Struct(_format_of(value))
    return _DESCRIBED[key]


def _class_of(value: Any) -> Any:
    """What tells values of two types apart."""
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim, value.flags.num & ~OWNS
    if isinstance(value, tuple):
        return type(value), *map(_class_of, value)
    return id(getattr(value, "_numba_type_", type(value)))


OWNS = 4
"""The flag of an array that owns its memory, which its type does not tell."""


def _format_of(value: Any) -> str:
    """Format of a value as compiled code holds it, for `struct`."""
    if isinstance(value, tuple):  # begins and ends at whole words
        return "".join(["0q", *map(_format_of, value), "0q"])
    if isinstance(value, np.ndarray):
        return f"PPqqP{2 * value.ndim}q"
    if value is None or hasattr(value, "_numba_type_"):
        return "P"
    return {types.boolean: "?", types.int64: "q", types.float64: "d"}[typeof(value)]


def _lay_out(value: Any, numbers: list[Any]) -> None:
    """Append the numbers of a value as compiled code holds it."""
    if isinstance(value, np.ndarray):
        place = value.__array_interface__["data"][0]
        numbers += (0, 0, value.size, value.itemsize, place, *value.shape, *value.strides)
    elif isinstance(value, tuple):
        for each in value:
            _lay_out(each, numbers)
    elif value is None:
        numbers.append(0)
    else:
        numbers.append(value.address if hasattr(value, "_numba_type_") else value)


@unbox(BorrowedTuple)
def read_address(kind, value, context):
    """The address that `Lent` holds."""
    address = context.pyapi.object_getattr_string(value, "address")
    pointer = context.pyapi.long_as_voidptr(address)
    context.pyapi.decref(address)
    return NativeValue(context.builder.bitcast(pointer, context.context.get_value_type(kind)))


@type_callable(borrowed)
def type_of_borrowed(context):
    return type_when_borrowed


@lower_builtin(borrowed, types.Any)
def write_borrowed(context, builder, signature, arguments):
    value = _value_of(context, builder, signature.args[0], arguments[0])
    if isinstance(signature.args[0], types.BaseNamedTuple):
        return cgutils.alloca_once_value(builder, value)
    return value


@type_callable(hold)
def type_of_hold(context):
    return lambda value: types.none


@lower_builtin(hold, types.Any)
def write_hold(context, builder, signature, arguments):
    return context.get_dummy_value()


borrowed.made_of = {object: (type_of_borrowed, write_borrowed)}  # type: ignore[attr-defined]
hold.made_of = {object: (type_of_hold, write_hold)}  # type: ignore[attr-defined]
