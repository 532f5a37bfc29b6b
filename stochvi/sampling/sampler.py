"""A sampler: how a block of paths is simulated, and what is added up, merged and counted of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

from stochvi.results.deadline import NEVER, Deadline
from stochvi.sampling.blocks import in_pieces

Piece = TypeVar("Piece")
Sample = TypeVar("Sample")

MARGIN, LEAST_GROWTH, MOST_GROWTH = 1.1, 0.1, 3.0
"""Factor on the number of missing paths, and the limits of its ratio to the number of paths so
far."""


class Sampler(ABC, Generic[Piece, Sample]):
    """A plan of paths together with a reducer; all else of a simulation is done for it.

    A sampler holds the seed and what describes its paths, and is sent to workers: a dataclass whose
    arrays are cached properties, which are made anew there (`SmallPickle`). All its results are
    functions of these fields and of the numbers of the paths alone. `digest_of` these fields names
    its results in a checkpoint, so that these must consist of what `to_plain` can keep.
    """

    @property
    @abstractmethod
    def block(self) -> int:
        """Number of paths that one call simulates together."""

    @abstractmethod
    def simulate(self, first_path: int, paths: int) -> Piece:
        """Simulate the paths first_path, first_path + 1, ...; the result has a row for each."""

    @abstractmethod
    def add_up(self, pieces: list[Piece]) -> Sample:
        """The sample of a block, whose paths were simulated in these pieces."""

    @abstractmethod
    def merge(self, sample: Sample, more: Sample) -> Sample:
        """The sample of both groups of paths, the second of which follow the first."""

    @abstractmethod
    def paths(self, sample: Sample) -> int:
        """Number of paths in a sample."""

    def sample(self, first_path: int, paths: int, deadline: Deadline) -> Sample:
        """The sample of a block, or of its first paths where the deadline passes before its end.

        Raises `GivenUp` where there are none.
        """
        return self.add_up(in_pieces(self.simulate, first_path, paths, deadline))

    def is_whole(self, sample: Sample, paths: int) -> bool:
        """Whether the sample of a block holds all of it."""
        return self.paths(sample) == paths

    def merge_cut(self, sample: Sample | None, cut: Sample) -> Sample:
        """The sample with a block behind it that the deadline has cut."""
        return cut if sample is None else self.merge(sample, cut)

    def describe(self, sample: Sample) -> str:
        """A sentence for the progress."""
        return f"{self.paths(sample)} paths"


class ListSampler(Sampler[Any, list[Any]]):
    """A sampler whose sample is the list of its blocks: what is concatenated is so once a round."""

    def merge(self, sample: list[Any], more: list[Any]) -> list[Any]:
        """The blocks of both."""
        return [*sample, *more]


class TrialSampler(ListSampler):
    """A sampler whose blocks are made as a whole or given up, as a part of one would over-represent
    what happens early; its sample is the list of their results."""

    @abstractmethod
    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Any:
        """The result of a block; `GivenUp` if the deadline passes before its end."""

    def simulate(self, first_path: int, paths: int) -> Any:
        """The result of a block."""
        return self.trial(first_path, paths, NEVER)

    def add_up(self, pieces: list[Any]) -> list[Any]:
        """The results."""
        return pieces

    def sample(self, first_path: int, paths: int, deadline: Deadline, *start: Any) -> list[Any]:
        """The result of a block, which may go on from a start."""
        return [self.trial(first_path, paths, deadline, *start)]

    def paths(self, sample: list[Any]) -> int:
        """Number of paths."""
        return len(sample) * self.block

    def is_whole(self, sample: list[Any], paths: int) -> bool:
        """True, as blocks are made as a whole."""
        return True


def more_paths(paths: int, error: float, rel_error: float) -> int:
    """Number of paths to add to `paths`, whose relative error is `error`, for `rel_error`; 0 if
    they suffice.

    Errors fall with the square root of the number of paths; they are known less well than that.
    Between a tenth and three times as many paths are added.

    >>> more_paths(100, 0.02, 0.01), more_paths(100, 0.01, 0.01)
    (300, 0)
    """
    if error <= rel_error:
        return 0
    growth = (error / rel_error) ** 2 - 1.0
    return math.ceil(paths * min(max(MARGIN * growth, LEAST_GROWTH), MOST_GROWTH))
