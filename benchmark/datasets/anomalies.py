"""Problems of a data set, joined by kind: each on one line with its files and a hint."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from benchmark.text import listed

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Anomaly:
    """A problem in a data set.

    Parameters
    ----------
    severity
        ``"error"`` if the data set or the shape is unusable without a fix, otherwise ``"warning"``.
    files
        The files, relative to the folder, or the identifiers of generated shapes.
    what, hint
        The problem, and a suggested action.
    """

    severity: str
    files: tuple[str, ...]
    what: str
    hint: str

    def __str__(self) -> str:
        count = f"{len(self.files)} files: " if len(self.files) > 1 else ""
        return f"{self.severity:<7}  {count}{listed(self.files)}  {self.what}; {self.hint}"


def by_kind(anomalies: Iterable[Anomaly]) -> tuple[Anomaly, ...]:
    """Join problems that differ in files and numbers alone; return them with errors first.

    Of several numbers, the least and the largest are said. The file with the largest number is
    named first.
    """
    kinds = defaultdict[tuple[str, ...], list[Anomaly]](list)
    for anomaly in anomalies:
        kinds[_kind(anomaly)].append(anomaly)
    joined = [_joined(members) for members in kinds.values()]
    return tuple(sorted(joined, key=lambda anomaly: anomaly.severity))


def _kind(anomaly: Anomaly) -> tuple[str, ...]:
    """Return what problems of one kind have in common; warnings of one kind have one hint."""
    what = anomaly.what if anomaly.severity == "error" else ""
    return anomaly.severity, _NUMBER.sub("", what), _NUMBER.sub("", anomaly.hint)


def _joined(members: Sequence[Anomaly]) -> Anomaly:
    """Return one anomaly that stands for several of the same kind.

    It names all their files. Numbers in which the messages differ become ranges: "3 to 7 holes".

    Parameters
    ----------
    members
        Anomalies whose messages differ in numbers alone.
    """
    # The one with the largest numbers comes first, and gives the joint one its other properties.
    members = sorted(members, key=_numbers, reverse=True)
    files: list[str] = []
    for anomaly in members:
        files += anomaly.files
    return replace(
        members[0],
        files=tuple(files),
        what=_with_ranges([anomaly.what for anomaly in members]),
        hint=_with_ranges([anomaly.hint for anomaly in members]),
    )


def _with_ranges(texts: Sequence[str]) -> str:
    """Return the first of some texts, with the range of each number that differs between them."""
    numbers = [_NUMBER.findall(text) for text in texts]
    if len(set(map(len, numbers))) > 1:
        return texts[0]
    ranges = iter([_range_of(values) for values in zip(*numbers, strict=True)])
    return _NUMBER.sub(lambda _: next(ranges), texts[0])


def _range_of(numbers: Sequence[str]) -> str:
    """Return the least and the largest of some numbers, as they are written."""
    least = min(numbers, key=float)
    largest = max(numbers, key=float)
    return largest if least == largest else f"{least} to {largest}"


def _numbers(anomaly: Anomaly) -> list[float]:
    """Return the numbers in the texts of a problem, those of the hint first."""
    return [float(number) for number in _NUMBER.findall(f"{anomaly.hint} {anomaly.what}")]
