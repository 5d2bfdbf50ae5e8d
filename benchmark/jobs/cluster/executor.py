"""The jobs of a plan on an existing dask cluster."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from benchmark.errors import ConfigurationError
from benchmark.jobs.execution.claims import Claims
from benchmark.jobs.execution.executors import Run, Watch
from benchmark.jobs.job_specs import JobSpec
from benchmark.storage.records import Record


@dataclass(frozen=True)
class DaskExecutor:
    """Orders to the workers of a dask cluster, each of which does them in guarded processes of its own.

    Parameters
    ----------
    url
        Address of the scheduler.
    claims
        The jobs that other runs are at.
    timeout
        Seconds of work after which a job is stopped; None for no limit.
    most
        Tasks at a time; None for all threads of the cluster.

    Raises
    ------
    ConfigurationError
        If dask is not installed.
    """

    url: str
    claims: Claims
    timeout: float | None = None
    most: int | None = None

    def __post_init__(self) -> None:
        if importlib.util.find_spec("distributed") is None:
            raise ConfigurationError(
                "the executor dask needs the package distributed", "run `pip install 'dask[distributed]'`"
            )

    def execute(self, jobs: Sequence[JobSpec], watch: Watch) -> Iterator[tuple[JobSpec, Record]]:
        """Do the jobs, handing back each record as soon as its job ends.

        Raises
        ------
        ConfigurationError
            If no scheduler answers, or all workers differ from this machine in what they would do.
        BenchmarkError
            If the scheduler is gone, or no worker comes for long.
        """
        if not jobs:
            return
        from benchmark.jobs.cluster.dask_pool import DaskWorkerPool

        with DaskWorkerPool(self.url, jobs, self.most) as pool:
            yield from Run(list(jobs), pool, self.claims, self.timeout, watch).records()
