"""Parts of a plan for several machines that share nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.errors import ConfigurationError
from benchmark.execution.job_specs import Job
from benchmark.pipeline.storage import keys


@dataclass(frozen=True)
class Shard:
    """One of several parts of a plan.

    The cut goes between jobs, never through one. A job leaves one record, whole and small, so shards need no common
    disk, no order in which they end, and nobody who ranks afterwards what others have treated; what joins records of
    several machines joins shards. The price is that shapes which jobs of several shards share are prepared in each.

    Parameters
    ----------
    number
        Which part, from 1.
    count
        How many parts there are.
    """

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Read ``"2/3"``.

        Raises
        ------
        ConfigurationError
            If it is anything else, or there is no such part.
        """
        hint = "write i/n with i from 1 to n, such as 2/3"
        numbers = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
        if not numbers:
            raise ConfigurationError(f"'{text}' is no shard", hint)
        shard = cls(int(numbers[1]), int(numbers[2]))
        if not 1 <= shard.number <= shard.count:
            raise ConfigurationError(f"there is no shard {shard}", hint)
        return shard

    def of(self, jobs: Sequence[Job]) -> list[Job]:
        """The jobs of this part.

        What is done already plays no part in the cut, so that shards begun at different times, or begun again, still
        fit together. The largest galleries are dealt out first, each job to the shard that has the fewest shapes.

        Parameters
        ----------
        jobs
            The whole plan; a job that it names twice, for two tables, is in one shard.
        """
        distinct = {_identity(job): len(job.identifiers) for job in jobs}
        load, place = [0] * self.count, {}
        for identity, size in sorted(distinct.items(), key=lambda pair: -pair[1]):  # equal ones stay in plan order
            place[identity] = min(range(self.count), key=lambda number: load[number])
            load[place[identity]] += size
        return [job for job in jobs if place[_identity(job)] == self.number - 1]

    def description(self, jobs: Sequence[Job]) -> str:
        """Return a line on this part; shards belong together if they name the same plan.

        Parameters
        ----------
        jobs
            The whole plan.
        """
        own, of_all = ({_identity(job) for job in some} for some in (self.of(jobs), jobs))
        return f"shard {self} of plan {keys.digest(sorted(of_all))[:8]}: {len(own)} of {len(of_all)} jobs"


def _identity(job: Job) -> str:
    """Return what makes a job one: its key, or its name where it has none."""
    return job.key or job.name
