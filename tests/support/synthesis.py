"""The response domain made again from the random numbers themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stochvi.engine.arithmetic import Log
from stochvi.mathematics.spectra import bin_amplitudes
from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.modal_tables import ModalTablesPlan
from stochvi.motion.synthesis import MOST_BLOCKS
from stochvi.scenes.scene import Scene
from support.naive import normals

SEED = 41


@dataclass(frozen=True)
class OfMass:
    """A plan of one mass under one table, read in the coordinate of that mass."""

    plan: ModalTablesPlan

    @classmethod
    def of(cls, scene: Scene, threshold: float | None = 0.0, duration: float | None = None) -> Any:
        plan = make_plan(model_of(scene), threshold, duration)
        assert isinstance(plan, ModalTablesPlan)
        return cls(plan)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plan, name)

    def coarser(self) -> OfMass:
        return OfMass(self.plan.coarser())

    def finer(self) -> OfMass:
        return OfMass(self.plan.finer())

    def with_step(self, step: float) -> OfMass:
        return OfMass(self.plan.with_step(step))

    def with_one_step_of_warm_up(self) -> OfMass:
        """Paths that begin as if there were no stops, one step before they count."""
        law = self.plan.law._replace(mean=np.zeros(1))
        return OfMass(replace(self.plan, burn_in=self.plan.step, law=law))

    @property
    def table(self) -> Any:
        """The table, of the base acceleration."""
        (table,) = self.plan.model.acceleration_tables
        return table

    @property
    def shape(self) -> float:
        return float(self.plan.modes.shapes[0, 0])

    @cached_property
    def waves(self) -> np.ndarray:
        """Amplitude of each synthesised bin, m."""
        return np.asarray(self.shape * self.plan.amplitudes[:, 0, 0])

    @cached_property
    def unfolded(self) -> np.ndarray:
        """The same without what lies beyond the cut, m."""
        modes = self.plan.modes
        ((table, force),) = modes.tables
        found, _ = bin_amplitudes(
            table, force, np.diag(modes.squares), modes.damping, self.plan.block_length,
            self.plan.samples // 2,
        )  # fmt: skip
        return np.asarray(self.shape * found[:, 0])

    @property
    def frequencies(self) -> np.ndarray:
        """Of the bins that are synthesised, rad/s."""
        return 2.0 * np.pi / self.plan.block_length * np.arange(1, len(self.waves) + 1)

    def free(self, first_path: int, paths: int) -> np.ndarray:
        """The displacement without stops in the first block, (samples, paths)."""
        return self.shape * self.plan.free_response(SEED, first_path, paths, 0)[:, 0, 0::2]

    def averages(
        self, seed: int, first: int, paths: int, record: np.ndarray | None = None,
        log: Log | None = None,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """Time averages (paths,) by what they are, displacements from the rest position."""
        found = self.plan.averages(seed, first, paths, record, log)
        rows = zip(self.plan.layout.rows, found, strict=True)
        named = {what: row for (_, what), row in rows if not what.startswith("free")}
        (origin,) = self.plan.layout.origins.values()
        away = origin - self.plan.model.rest
        named["xx"] = named["xx"] + 2.0 * away * named["x"] + away**2
        named["x"] = named["x"] + away
        return named

    def recorded(
        self, seed: int, first: int, paths: int, log: Log | None = None
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The averages, and x, v and impact speeds of every sample (samples, paths, 3)."""
        record = np.zeros((self.plan.steps, paths, self.plan.record_width))
        found = self.averages(seed, first, paths, record, log)
        return found, record * np.array([self.shape, self.shape, 1.0])[: self.plan.record_width]


def coefficients(path: int, waves: np.ndarray) -> np.ndarray:
    """a - i b of the bins of the first block of a path, from the random numbers themselves."""
    z = normals(SEED, path * MOST_BLOCKS, 2 * len(waves))
    coefficient: np.ndarray = waves * (z[::2] - 1j * z[1::2])
    return coefficient


AIM = 0.002
"""Relative error that the sampling is chosen for."""
