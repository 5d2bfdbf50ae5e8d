"""Divide a plan between machines that share nothing."""

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

    Each job belongs to exactly one shard and writes one small record. Shards therefore need no shared disk and can end
    in any order, and ``merge`` joins their records. The drawback is that shapes used by jobs of several shards are
    prepared in each of them.

    Parameters
    ----------
    number
        Number of the part, from 1.
    count
        Number of parts.
    """

    number: int
    count: int

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> Shard:
        """Parse a text such as ``"2/3"``.

        Raises
        ------
        ConfigurationError
            If it is anything else, or there is no such part.
        """
        hint = "write i/n with i from 1 to n, such as 2/3"
        numbers = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", text.strip())
        if not numbers:
            raise ConfigurationError(f"'{text}' is not a shard", hint)
        shard = cls(int(numbers[1]), int(numbers[2]))
        if not 1 <= shard.number <= shard.count:
            raise ConfigurationError(f"there is no shard {shard}", hint)
        return shard

    def of(self, jobs: Sequence[Job]) -> list[Job]:
        """Return the jobs of this part.

        The division does not depend on which jobs are finished, so that shards started or resumed at different times
        still fit together. Jobs with the largest galleries are assigned first, each to the shard with the fewest
        shapes.

        Parameters
        ----------
        jobs
            The complete plan; a job that appears twice, in two tables, is in one shard.
        """
        distinct = {_identity(job): len(job.identifiers) for job in jobs}
        load, place = [0] * self.count, {}
        for identity, size in sorted(distinct.items(), key=lambda pair: -pair[1]):  # ties stay in plan order
            place[identity] = min(range(self.count), key=lambda number: load[number])
            load[place[identity]] += size
        return [job for job in jobs if place[_identity(job)] == self.number - 1]

    def description(self, jobs: Sequence[Job]) -> str:
        """Describe this part in one line; shards belong together if the digest of the plan is the same.

        Parameters
        ----------
        jobs
            The complete plan.
        """
        own, of_all = ({_identity(job) for job in some} for some in (self.of(jobs), jobs))
        return f"shard {self} of plan {keys.digest(sorted(of_all))[:8]}: {len(own)} of {len(of_all)} jobs"


def _identity(job: Job) -> str:
    """Return the key of a job, or its name if it has no key."""
    return job.key or job.name
