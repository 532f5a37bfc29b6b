"""The laws of the stops of a structure, in a table of numbers and one of compiled functions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.core import config
from numpy.typing import NDArray

from stochvi.engine.law import is_lossy, is_rigid, is_smooth
from stochvi.engine.law_calls import OF_LANES, OF_MASS, OF_SHAKEN, OF_STOP, functions_of_class


class Stops(NamedTuple):
    """The stops of all pairs, with forces per unit of the reduced mass of each pair.

    Parameters
    ----------
    places : (pairs, 2), m, positions of the lower and the upper stop, infinite for none.
    kinds : (pairs, 2), number of the class of each law.
    rigid, lossy, smooth : (pairs, 2), traits of each law; a place without a stop counts as rigid.
    numbers : (2 pairs, width), numbers of the law of each stop.
    order, ranks : (2 pairs,), the stops, 2 j + 1 for the upper one of the pair j, sorted by the
        classes of their laws; and the place of each in that order.
    thresholds : (pairs,), m/s, speed of the slowest impact that is counted.
    tangents : (pairs,), the pair without stops whose gap is the motion along those of this pair,
        below 0 where nothing rubs; None where no pair rubs, whose friction is then absent from the
        compiled code.
    ratios : (pairs,), reduced mass of the pair over that of its tangent.
    frictions : (pairs, 2), coefficient of friction of each stop.
    rubs : None where no compliant stop rubs, whose friction is then absent from the compiled code;
        else an empty array.
    """

    places: NDArray[np.float64]
    kinds: NDArray[np.int64]
    rigid: NDArray[np.bool_]
    lossy: NDArray[np.bool_]
    smooth: NDArray[np.bool_]
    numbers: NDArray[np.float64]
    order: NDArray[np.int64]
    ranks: NDArray[np.int64]
    thresholds: NDArray[np.float64]
    tangents: NDArray[np.int64] | None
    ratios: NDArray[np.float64]
    frictions: NDArray[np.float64]
    rubs: NDArray[np.float64] | None


_COMPILED: dict[type, tuple[Any, ...]] = {}
"""Functions of one stop, of many lanes, of one mass, and of one that is shaken, by the class of
their laws. Their machine code must live as long as this process."""


def functions_of(
    laws: list[Any], *, lanes: bool = False, mass: bool = False, shaken: bool = False
) -> NDArray[Any]:
    """Addresses of the functions of classes of laws, (classes, 4): of one stop, of many lanes, of
    one mass, and of one that is shaken. Those of many lanes, or of one mass instead of one stop,
    are compiled where they are wanted and the law is compliant.

    Addresses hold for this process only. Without compilation they are the functions.
    """
    signatures = (OF_STOP, OF_LANES, OF_MASS, OF_SHAKEN)
    table = np.zeros((len(laws), len(signatures)), object if config.DISABLE_JIT else np.int64)
    for row, law in zip(table, laws, strict=True):
        kind = type(law)
        if kind not in _COMPILED:
            # the numbers of this law must not become part of the code
            blank = (np.zeros((1,) * np.ndim(each)) if np.ndim(each) else 0.0 for each in law)
            _COMPILED[kind] = functions_of_class(kind(*blank))  # type: ignore[no-untyped-call]
        compliant = not is_rigid(law)
        of_one = mass and compliant, shaken and compliant
        wanted = not any(of_one), lanes and compliant, *of_one
        for k, signature in enumerate(signatures):
            function = _COMPILED[kind][k]
            if config.DISABLE_JIT:
                row[k] = function
            elif wanted[k]:
                row[k] = address_of(function, signature)
    return table


def address_of(function: Any, signature: Any) -> int:
    function.compile(signature)
    compiled = function.overloads[signature.args]
    address: int = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
    return address


def row_of_numbers(law: Any) -> NDArray[np.float64]:
    """The numbers of a law, as `read` finds them in a table."""
    return np.concatenate([np.ravel(np.asarray(each, float)) for each in law])


def stops_of(
    places: NDArray[np.float64], thresholds: NDArray[np.float64],
    laws: dict[tuple[int, int], Any], tangents: NDArray[np.int64] | None = None,
    ratios: NDArray[np.float64] | None = None, frictions: NDArray[np.float64] | None = None,
) -> tuple[Stops, list[Any]]:  # fmt: skip
    """The stops of all pairs, and a law of each class, for `functions_of`.

    `laws` holds the law of each stop by its pair and 0 for the lower, 1 for the upper stop; the
    other arrays are those of `Stops`, and left out where nothing rubs.
    """
    example = {type(law): law for law in laws.values()}
    classes = sorted(example, key=lambda kind: kind.__qualname__)
    rows = {2 * pair + upper: row_of_numbers(law) for (pair, upper), law in laws.items()}
    width = max((len(row) for row in rows.values()), default=1)
    numbers = np.zeros((2 * len(places), width))
    kinds = np.zeros(places.shape, np.int64)
    rigid, lossy, smooth = np.ones(places.shape, bool), *np.zeros((2, *places.shape), bool)
    for (pair, upper), law in laws.items():
        at, row = (pair, upper), rows[2 * pair + upper]
        numbers[2 * pair + upper, : len(row)] = row
        kinds[at] = classes.index(type(law))
        rigid[at], lossy[at], smooth[at] = is_rigid(law), is_lossy(law), is_smooth(law)
    order = np.argsort(kinds.ravel(), kind="stable")
    soft = frictions is not None and bool(np.any(frictions[~rigid] > 0.0))
    stops = Stops(
        places, kinds, rigid, lossy, smooth, numbers, order, np.argsort(order), thresholds,
        tangents if tangents is not None and bool(np.any(tangents >= 0)) else None,
        np.ones(len(places)) if ratios is None else ratios,
        np.zeros(places.shape) if frictions is None else frictions,
        np.zeros(0) if soft else None,
    )  # fmt: skip
    return stops, [example[kind] for kind in classes]
