"""The bits of a float number as a word, and back: one instruction, or none.

numba compiles a function for each `np.float64(x).view(np.uint64)` of a kernel.
"""

from typing import Any

import numpy as np
from numba.core import types
from numba.extending import lower_builtin, type_callable


def bits_of(number: float) -> np.uint64:
    """The bits of a float number."""
    return np.float64(number).view(np.uint64)


def number_of(bits: np.uint64) -> np.float64:
    """The float number of these bits."""
    return np.uint64(bits).view(np.float64)


@type_callable(bits_of)
def type_of_bits(context: Any) -> Any:
    return lambda number: types.uint64


@type_callable(number_of)
def type_of_number(context: Any) -> Any:
    return lambda bits: types.float64


@lower_builtin(bits_of, types.float64)
@lower_builtin(number_of, types.uint64)
def write_cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Emit the other view of the same bits."""
    return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))


bits_of.made_of = {object: (type_of_bits, write_cast)}  # type: ignore[attr-defined]
number_of.made_of = {object: (type_of_number, write_cast)}  # type: ignore[attr-defined]
