"""Impacts in the answer of `damage`: counts, energies and shocks, by clusters or by records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Vector
from stochvi.model.model import Model
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.intervals import mean_and_error, upper_limit_unseen
from stochvi.statistics.damage.answer import Shocks
from stochvi.statistics.damage.clusters import Clusters
from stochvi.statistics.damage.records import DamageSampler, RecordPiece

RARE = 0.01
"""Share of the windows with an impact that exceed the worst shock."""

HOUR = 3600.0


class DamageHits(NamedTuple):
    """Impacts of a scene; fields as in `Damage`."""

    shocks: Shocks | None
    impacts_per_hour: Estimate
    contacts_above: Mapping[str, Estimate]
    work_per_hour: Estimate
    loss_per_hour: Estimate


def _all_rigid(model: Model) -> bool:
    return all(stop.rigid for stop in model.stops)


def hits_of_clusters(found: Clusters, levels: Sequence[float]) -> DamageHits:
    """Impacts of all clusters."""
    part, soft = found.part, not _all_rigid(found.sampler.clusters.model)
    return DamageHits(
        shocks=Shocks(
            typical=found.shock(0.5), worst=found.shock(1.0 - RARE), window=found.sampler.seconds,
            windows=len(part.path),
        ),
        impacts_per_hour=found.rate(part.hits, HOUR),
        contacts_above={
            f"{a:g}": found.rate(each, HOUR)
            for a, each in zip(levels, part.above.T, strict=True) if soft
        },
        work_per_hour=found.rate(part.work, HOUR, False),
        loss_per_hour=found.rate(part.loss, HOUR, False),
    )  # fmt: skip


class Records(NamedTuple):
    """Records of a scene, and the counts of their impacts."""

    sampler: DamageSampler
    sample: RecordPiece

    @property
    def paths(self) -> int:
        """Number of independent records."""
        return len(self.sample.hits)

    @property
    def seconds(self) -> float:
        """Counted time of all records, s."""
        return self.paths * self.sampler.seconds

    @property
    def work(self) -> dict[str, int]:
        """What was simulated."""
        plan = self.sampler.plan
        steps = self.paths * (plan.samples + plan.plan.settling)
        return {"steps": steps, "paths": self.paths, "impacts": int(self.sample.hits.sum())}

    def per_hour(self, counts: Vector, events: bool = True) -> Estimate:
        """Events, or energy, per hour; no energy has no upper limit."""
        value, error = mean_and_error(counts)
        how = f"{self.paths} records, {self.seconds:.4g} s"
        if not value and not events:
            return Estimate(value=0.0, bias=None, how=f"none in {how}")
        if not value:
            most = HOUR * upper_limit_unseen(self.seconds)
            return Estimate(value=0.0, bias=None, how=f"none in {how}", upper_95=most)
        hourly = HOUR / self.sampler.seconds
        found = Estimate(value=value * hourly, standard_error=error * hourly, how=how)
        return of_events(found, self.paths)

    def hits(self, levels: Sequence[float]) -> DamageHits:
        """Impacts of all records. Rigid stops have no contacts with an acceleration."""
        above = {f"{a:g}": each for a, each in zip(levels, self.sample.above.T, strict=True)}
        soft = not _all_rigid(self.sampler.plan.model)
        return DamageHits(
            shocks=self.shocks(),
            impacts_per_hour=self.per_hour(self.sample.hits),
            contacts_above={a: self.per_hour(each) for a, each in above.items() if soft},
            work_per_hour=self.per_hour(self.sample.work, False),
            loss_per_hour=self.per_hour(self.sample.loss, False),
        )

    def shocks(self) -> Shocks | None:
        """Shock spectra of the windows with an impact."""
        struck = self.sample.peaks[self.sample.struck]
        if not len(struck):
            return None
        return Shocks(
            typical=np.median(struck, axis=0), worst=np.quantile(struck, 1.0 - RARE, axis=0),
            window=self.sampler.window * self.sampler.plan.step, windows=len(struck),
        )  # fmt: skip
