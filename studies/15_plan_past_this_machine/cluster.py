"""An executor that imitates a thousand workers: its clock is a number that it moves itself."""

import heapq
import math
import random
import time
from concurrent.futures import Executor, Future

import numpy as np

from stochvi.model.model import model_of
from stochvi.motion.choose_plan import make_plan
from stochvi.motion.plan import PathStatistics
from stochvi.results.deadline import NEVER
from stochvi.sampling.workers import SENDING_SECONDS, WorkerPool

STRAGGLER = 10.0
"""How much longer a straggler takes."""

SPREAD = 0.2
"""Standard deviation of log(time) of a task on a machine that others use too."""


class Cluster(Executor):
    """Tasks go to the worker that is free first; one in some is late, one in some is lost.

    Work takes time on the clock of the cluster, and so does sending it, which one scheduler does
    for all. A result is computed once for each kind of task (by step and number of paths) and then
    given again, unless `real`: what is simulated here is the cluster, not the paths.
    """

    def __init__(self, workers: int, *, block_seconds: float, sending: float, late: float,
                 lost: float, seed: int = 0, real: bool = False) -> None:  # fmt: skip
        self.free = [0.0] * workers
        self.block_seconds, self.sending = block_seconds, sending
        self.late, self.lost, self.real = late, lost, real
        self.random = random.Random(seed)
        self.known: dict[tuple[bytes, int], object] = {}
        self.now = 0.0
        self.tasks = self.again = self.open_blocks = self.most_open_blocks = 0

    def submit(self, function, sampler, blocks, deadline=NEVER, needed=0, attempt=1):
        self.now += self.sending / 2.0
        self.tasks += 1
        self.again += attempt > 1
        self.open_blocks += len(blocks) * (attempt == 1)
        self.most_open_blocks = max(self.most_open_blocks, self.open_blocks)
        seconds = self.block_seconds * len(blocks)
        seconds *= self.random.lognormvariate(0.0, SPREAD)
        seconds *= STRAGGLER if self.random.random() < self.late else 1.0
        lost = self.random.random() < self.lost
        end = max(self.now, heapq.heappop(self.free)) + seconds
        heapq.heappush(self.free, end)
        return Later(self, end, lost, function, (sampler, blocks))

    def result(self, function, sampler, blocks):
        """Of a task, as if it had run; `sampler` is a packet of its fields."""
        if self.real:
            done = function(sampler, blocks, NEVER)
        else:
            names = [(sampler, count) for _, count in blocks]
            for name, block in zip(names, blocks, strict=True):
                if name not in self.known:
                    self.known[name] = function(sampler, (block,), NEVER)
            samples = tuple(self.known[name].samples[0] for name in names)
            done = self.known[names[0]]._replace(samples=samples)
        return done._replace(seconds=self.block_seconds * len(blocks))


class Later(Future):
    """Known when the clock has come to its end; lost ones then have to be done again."""

    def __init__(self, cluster: Cluster, end: float, lost: bool, function, call) -> None:
        super().__init__()
        self.cluster, self.end, self.lost, self.task = cluster, end, lost, (function, *call)

    def done(self) -> bool:
        return self.end <= self.cluster.now

    def exception(self, timeout=None):
        return ConnectionError("the worker is gone") if self.lost else None

    def cancel(self) -> bool:
        return False

    def result(self, timeout=None):
        cluster = self.cluster
        if timeout is not None and self.end > cluster.now + timeout:
            cluster.now += timeout
            raise TimeoutError
        cluster.now = max(cluster.now, self.end) + cluster.sending / 2.0
        if self.lost:
            raise self.exception()
        cluster.open_blocks -= len(self.task[-1])
        return cluster.result(*self.task)


def block_costs(scene, duration: float, merges: int) -> dict[str, float]:
    """CPU seconds of one block of paths of this length, and of one merge, here and now."""
    plan = make_plan(model_of(scene), None, duration)
    start = time.process_time()
    averages = plan.averages(0, 0, plan.block)
    seconds = time.process_time() - start
    layout = plan.layout
    known = [PathStatistics.of(averages + np.sin(k), layout) for k in range(100)]
    total, start = PathStatistics.none(layout), time.process_time()
    for number in range(merges):
        total = total.merge(known[number % 100])
    assert total.count == merges * plan.block
    return {
        "duration": plan.duration,
        "steps_of_a_block": plan.block * plan.steps_per_path,
        "block_s": seconds,
        "merges": merges,
        "merge_s": (time.process_time() - start) / merges,
    }


def plan_for(costs: dict[str, float], steps: float, cores: int) -> dict[str, float]:
    """Seconds that a number of steps takes on some cores: work, sending of tasks, merging."""
    blocks = steps / costs["steps_of_a_block"]
    tasks = 0.0
    if cores > 1:
        pool = WorkerPool(None, cores, external=True, block_seconds=costs["block_s"])
        tasks = blocks / pool.per_task(math.ceil(blocks))
    rounds = math.ceil(tasks / cores) * cores / tasks if tasks else 1.0  # some wait at the end
    found = {
        "work_s": blocks * costs["block_s"] / cores * rounds,
        "sending_s": tasks * SENDING_SECONDS,
        "merging_s": blocks * costs["merge_s"],
    }
    wall = max(found["work_s"], found["sending_s"] + found["merging_s"])
    return {"cores": cores, **costs, **found, "tasks": tasks, "wall_s": wall}
