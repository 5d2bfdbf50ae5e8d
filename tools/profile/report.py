"""The profile of a run from the lines of its workers, as Markdown: parts that sum to the time of all workers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from benchmark.report.escaping import markdown_table

BEFORE, AFTER = "idle: before the first task (imports, plan)", "idle: after the last task (tables)"
TAIL, BETWEEN = "idle: the tail, in which not all work", "idle: between tasks"

#: Parts that tell methods apart.
BY_METHOD = ("form", "signature", "distances", "measures")


@dataclass(frozen=True)
class Profile:
    """Time of a run.

    Parameters
    ----------
    tasks
        A line of each task, see :mod:`tools.profile.account`.
    workers
        Tasks at a time.
    began, ended
        Of the whole program, in seconds since the epoch.
    processor
        Processor seconds of the program and its workers.
    """

    tasks: Sequence[dict[str, Any]]
    workers: int
    began: float
    ended: float
    processor: float

    @property
    def whole(self) -> float:
        """Seconds of all workers, busy or idle, from the start of the program to its end."""
        return self.workers * (self.ended - self.began)

    def parts(self) -> Counter[str]:
        """Seconds by part; they sum to :attr:`whole`."""
        found: Counter[str] = Counter()
        for task in self.tasks:
            left = task["ended"] - task["began"]
            for part, _, _, seconds, _ in task["parts"]:
                found[part] += seconds
                left -= seconds
            found["else in a worker"] += left
        found.update(self.idle())
        return found

    def processor_parts(self) -> Counter[str]:
        """Processor seconds of the workers by part."""
        found: Counter[str] = Counter()
        for task in self.tasks:
            for part, _, _, _, seconds in task["parts"]:
                found[part] += seconds
        return found

    def idle(self) -> Counter[str]:
        """Seconds in which workers had nothing to do, by the reason."""
        workers, spans = self.workers, self._spans()
        full = max((end for _, end, busy in spans if busy >= workers), default=self.began)
        first, last = (pick(task[at] for task in self.tasks) for pick, at in ((min, "began"), (max, "ended")))
        found = Counter({BEFORE: workers * (first - self.began), AFTER: workers * (self.ended - last)})
        for begin, end, busy in spans:
            found[TAIL if begin >= full else BETWEEN] += (workers - busy) * (end - begin)
        return found

    def methods(self) -> dict[str, Counter[str]]:
        """Processor seconds by method and part, of the parts that tell methods apart."""
        found: dict[str, Counter[str]] = {}
        for task in self.tasks:
            for part, method, _, _, seconds in task["parts"]:
                if method and part in BY_METHOD:
                    found.setdefault(method, Counter())[part] += seconds
        return found

    def markdown(self) -> str:
        """Tables by part and by method."""
        firsts: Counter[str] = Counter()
        for task in self.tasks:
            for part, _, first, _, seconds in task["parts"]:
                firsts[part] += seconds if first else 0
        of_parts = self.processor_parts()
        of_workers = of_parts.total()
        lines = [
            f"{self.ended - self.began:.0f} s, {self.workers} workers, {len(self.tasks)} tasks; "
            f"{self.processor:.0f} s of processor time, {of_workers:.0f} s of them in the workers.",
            "",
        ]
        parts, rows = self.parts(), []
        for part, seconds in [*parts.most_common(), ("sum", parts.total())]:
            used, first = (of_workers, firsts.total()) if part == "sum" else (of_parts[part], firsts[part])
            rows.append([part, f"{seconds / self.whole:.1%}", *(f"{each:.1f}" for each in (seconds, used, first))])
        lines += [*markdown_table(["part", "share", "seconds", "processor", "of that, first calls"], rows), ""]
        by_method = [
            [method, *(f"{found[part]:.1f}" for part in BY_METHOD), f"{found.total() / of_workers:.1%}"]
            for method, found in sorted(self.methods().items(), key=lambda each: -each[1].total())
        ]
        return "\n".join(lines + markdown_table(["method", *BY_METHOD, "share"], by_method))

    def _spans(self) -> list[tuple[float, float, int]]:
        """Spans between the beginnings and ends of tasks, with how many tasks were under way."""
        steps = sorted([(task["began"], 1) for task in self.tasks] + [(task["ended"], -1) for task in self.tasks])
        spans, busy = [], 0
        for (begin, step), (end, _) in pairwise(steps):
            busy += step
            spans.append((begin, end, busy))
        return spans
