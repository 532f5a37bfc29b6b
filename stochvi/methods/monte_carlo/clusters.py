"""Executor that simulates on the machines of a Dask cluster.

A cluster on this machine is one command each for the scheduler and the workers, in an environment
that has `pip install 'stochvi[distributed]'`:

    dask scheduler --port 8786
    dask worker tcp://localhost:8786 --nworkers 4 --nthreads 1

and `dask worker tcp://head:8786 --nworkers -1` on every other machine, or under a batch system.
Then `stochvi simulate scene.toml --dask tcp://head:8786`. Workers must have the same versions of
stochvi and its libraries, and the same kind of processor; else the digits depend on the worker, and
the response has a warning. Under MPI, `mpiexec -n 64 python -m mpi4py.futures job.py` with
`simulate(..., executor=MPIPoolExecutor())` in job.py.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

CONNECT_SECONDS = 10.0
"""Seconds to wait for the answer of a scheduler."""


@contextlib.contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Executor of the Dask cluster whose scheduler listens at `address`, "tcp://host:8786".

    Raises
    ------
    ValueError
        If Dask is not installed, no scheduler answers, or there are no workers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise ValueError("--dask needs Dask: pip install 'stochvi[distributed]'") from None
    try:
        client = Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"--dask: no scheduler answers at {address} ({type(error).__name__}); start one with "
            "'dask scheduler --port 8786' and name it as tcp://host:8786"
        ) from None
    with client:
        if not client.nthreads():
            raise ValueError(
                f"--dask: the scheduler at {address} has no workers; start some with "
                f"'dask worker {address} --nworkers 4'"
            )
        yield client.get_executor(pure=False)
