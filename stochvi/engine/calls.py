"""Calls of functions by their addresses.

A function that is compiled apart from the kernels that call it is known to them by its address. A
kernel is therefore compiled once, whichever function it calls. Addresses hold for one process.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import cgutils, types
from numba.extending import lower_builtin, type_callable


def call_by_address(signature: Any) -> Callable[..., Any]:
    """The call (function, arguments) of any function of a signature, for kernels.

    Without compilation the function stands in the place of its address.
    """
    kinds = signature.args

    def call(function, arguments):
        return function(*arguments)

    @type_callable(call)
    def type_of_call(context):
        return lambda function, arguments: signature.return_type

    @lower_builtin(call, types.Integer, types.BaseTuple)
    def write_call(context, builder, call, values):
        given = [
            context.cast(builder, builder.extract_value(values[1], k), argument, wanted)
            for k, (argument, wanted) in enumerate(zip(call.args[1], kinds, strict=True))
        ]
        native = [context.get_value_type(each) for each in kinds]
        result = context.get_value_type(signature.return_type)
        pointer = cgutils.ir.FunctionType(result, native).as_pointer()
        return builder.call(builder.inttoptr(values[0], pointer), given)

    call.made_of = {object: (type_of_call, write_call)}
    return call
