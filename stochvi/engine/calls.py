"""Calls of functions by their addresses.

A function that is compiled apart from the kernels that call it is known to them by its address. A
kernel is therefore compiled once, whichever function it calls. Addresses hold for one process.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import cgutils, types
from numba.extending import intrinsic, overload


def call_by_address(signature: Any) -> Callable[..., Any]:
    """The call (function, arguments) of any function of a signature, for kernels.

    Without compilation the function stands in the place of its address.
    """
    kinds = signature.args

    @intrinsic
    def call_at(typing, address, arguments):
        def codegen(context, builder, call, values):
            given = [
                context.cast(builder, builder.extract_value(values[1], k), arguments[k], wanted)
                for k, wanted in enumerate(kinds)
            ]
            native = [context.get_value_type(each) for each in kinds]
            result = context.get_value_type(signature.return_type)
            pointer = cgutils.ir.FunctionType(result, native).as_pointer()
            return builder.call(builder.inttoptr(values[0], pointer), given)

        return signature.return_type(types.intp, arguments), codegen

    def call(function, arguments):
        return function(*arguments)

    @overload(call)
    def choose(function, arguments):
        return lambda function, arguments: call_at(function, arguments)

    call.made_of = {object: (choose,)}
    return call
