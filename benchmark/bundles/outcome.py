"""Outcome of a verification: what of a bundle was computed again, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmark.bundles.manifest import BundleError, Status

#: From the worst to the best: a bundle is what the worst of its records is.
_ORDER: tuple[Status, ...] = ("unreadable", "false", "claimed", "verified")


@dataclass(frozen=True)
class Fault:
    """A reason why a record, or a bundle, is not verified.

    Parameters
    ----------
    name
        By which it is listed.
    problem, hint
        What is wrong, and what to do.
    status
        What the record is by it: ``"claimed"`` where nobody can tell, ``"false"`` where it is not so.
    """

    name: str
    problem: str
    hint: str
    status: Status

    @classmethod
    def of(cls, error: BundleError) -> Fault:
        """The same from an error."""
        return cls(error.name, error.problem, error.hint, error.status)


@dataclass(frozen=True, kw_only=True)
class RowOutcome:
    """Outcome of one record of a bundle.

    Parameters
    ----------
    key, gallery, data, data_title, input, scorer, seed, gallery_digest
        Which record, and of which shapes.
    faults
        Why it is not verified; empty where it is.
    scores
        By measure: computed again where that was possible, else as the record tells them.
    told
        As the record tells them.
    intervals
        Their 95 % intervals over classes.
    chance, n_shapes, n_classes, coverage
        Of the gallery, and the share of its shapes with a result.
    seconds, peak_mib, trained_on
        Seconds of a shape, memory and training data, as the record tells them: nobody can check them.
    holds, withheld
        What the bundle holds of it, and why it holds no forms.
    compared
        What labels and inputs were compared with: ``"data"``, ``"records"``, or "" for nothing.
    again, apart
        Shapes whose forms were made again, and how far these are from those of the bundle at most, relative to size.
    """

    key: str
    gallery: str
    data: str
    data_title: str
    input: str
    scorer: str
    seed: int
    gallery_digest: str
    faults: tuple[Fault, ...] = ()
    scores: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    chance: Mapping[str, float] = field(default_factory=dict)
    n_shapes: int = 0
    n_classes: int = 0
    coverage: float = 0.0
    seconds: float | None = None
    peak_mib: float | None = None
    trained_on: tuple[str, ...] = ()
    holds: str = ""
    withheld: str = ""
    compared: str = ""
    again: tuple[str, ...] = ()
    apart: float = 0.0

    @property
    def status(self) -> Status:
        """The worst that its faults make of it."""
        return worst(fault.status for fault in self.faults)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Outcome of a bundle.

    Parameters
    ----------
    digest
        SHA-256 of the bundle.
    method, title, author, licence, versions
        As it describes itself.
    plugin
        SHA-256 of the source of its plug-in; "" without one.
    rows
        Its records.
    faults
        What is wrong with the bundle as a whole.
    with_run
        Whether forms were to be made again.
    """

    digest: str = ""
    method: str = ""
    title: str = ""
    author: str = ""
    licence: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    plugin: str = ""
    rows: tuple[RowOutcome, ...] = ()
    faults: tuple[Fault, ...] = ()
    with_run: bool = False

    @property
    def status(self) -> Status:
        """The worst of its faults and records."""
        return worst((*(fault.status for fault in self.faults), *(row.status for row in self.rows)))

    def to_plain(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        rows = [{**asdict(row), "status": row.status} for row in self.rows]
        return {**asdict(self), "rows": rows, "status": self.status}

    @classmethod
    def from_plain(cls, content: Mapping[str, Any]) -> Outcome:
        """Read :meth:`to_plain`; raises ``KeyError`` or ``TypeError`` for anything else."""
        told = {name: part for name, part in content.items() if name != "status"}
        rows = tuple(_row(row) for row in content["rows"])
        return cls(**{**told, "rows": rows, "faults": _faults(content["faults"])})


def _row(content: Mapping[str, Any]) -> RowOutcome:
    told: dict[str, Any] = {
        name: tuple(part) if isinstance(part, list) else part for name, part in content.items() if name != "status"
    }
    return RowOutcome(**told | {"faults": _faults(content["faults"])})


def _faults(content: Iterable[Mapping[str, Any]]) -> tuple[Fault, ...]:
    return tuple(Fault(**fault) for fault in content)


def worst(statuses: Iterable[Status]) -> Status:
    """Return the worst of some statuses; ``"verified"`` where there are none."""
    return min(statuses, key=_ORDER.index, default="verified")


def claim(name: str, problem: str, hint: str) -> Fault:
    """Return a fault by which a record is a claim: nobody here can tell."""
    return Fault(name, problem, hint, "claimed")


def lie(name: str, problem: str, hint: str = "it may have been edited; ask its author") -> Fault:
    """Return a fault by which a record is false."""
    return Fault(name, problem, hint, "false")
