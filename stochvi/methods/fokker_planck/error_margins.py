"""How the difference of two meshes becomes a bound on the error of the finer one."""

from __future__ import annotations

from typing import NamedTuple


class ErrorMargins(NamedTuple):
    """The numbers that turn differences of two meshes into bounds.

    Parameters
    ----------
    safety
        Factor on the difference of the two meshes.
    shared
        Share of the largest relative difference in a group of quantities. Every member gets at
        least this error, because two meshes may agree on one of them by chance.
    floor
        Relative error that every number is granted, for the ends of the box and for rounding.
    """

    safety: float
    shared: float
    floor: float
