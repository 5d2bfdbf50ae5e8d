"""Outcomes of verification, and verified and claimed rows of bundles in reports."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec

from benchmark.bundles.archive import Fault, Status
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.pipeline.storage.record_schema import read_json
from benchmark.report.escaping import number
from retrieval.measures import PRINTED

_COMPARED = {"data": "labels and inputs compared with the data", "records": "labels and inputs compared with records"}


class RowOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of one record of a bundle.

    Parameters
    ----------
    key, gallery, data, data_title, input, scorer, seed, gallery_digest
        Description of the record and its shapes.
    faults
        Reasons why it is not verified; empty if it is.
    scores
        Scores by measure: recomputed if possible, otherwise as stated in the record.
    told
        Scores by measure, as stated in the record.
    intervals
        95 % intervals of the scores over classes, by measure.
    chance, n_shapes, n_classes, coverage
        Chance level by measure, size of the gallery, and the fraction of its shapes with a result.
    seconds, peak_mib, trained_on
        Seconds per shape, memory and training data, as stated in the record; they cannot be checked.
    holds, withheld
        Kind of data in the bundle, and the reason why it has no forms.
    compared
        Source with which labels and inputs were compared: ``"data"``, ``"records"``, or "" for none.
    again, apart
        Shapes whose forms were recomputed, and the largest distance of these forms from those in the bundle, relative
        to size.
    """

    key: str
    gallery: str
    data: str
    data_title: str
    input: str
    scorer: str
    seed: int
    gallery_digest: str
    faults: tuple[Fault, ...]
    scores: dict[str, float]
    told: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    chance: dict[str, float]
    n_shapes: int
    n_classes: int
    coverage: float
    seconds: float | None
    peak_mib: float | None
    trained_on: tuple[str, ...]
    holds: str
    withheld: str
    compared: str
    again: tuple[str, ...]
    apart: float

    @property
    def status(self) -> Status:
        """Worst status of its faults."""
        return worst(fault.status for fault in self.faults)


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of a bundle.

    Parameters
    ----------
    digest
        SHA-256 of the bundle.
    method, title, author, licence, versions
        Description from the manifest of the bundle.
    plugin
        SHA-256 of the source of its plugin; "" if it has none.
    rows
        Outcomes of its records.
    faults
        Faults of the bundle as a whole.
    with_run
        Whether the plugin was allowed to run.
    """

    digest: str
    method: str = ""
    title: str = ""
    author: str = ""
    licence: str = ""
    versions: dict[str, str] = {}
    plugin: str = ""
    rows: tuple[RowOutcome, ...] = ()
    faults: tuple[Fault, ...] = ()
    with_run: bool = False

    @property
    def status(self) -> Status:
        """Worst status of its faults and records."""
        return worst((*(fault.status for fault in self.faults), *(row.status for row in self.rows)))

    def to_plain(self) -> dict[str, Any]:
        """Return the outcome as plain values for JSON."""
        rows = [{**msgspec.to_builtins(row), "status": row.status} for row in self.rows]
        return {**msgspec.to_builtins(self), "rows": rows, "status": self.status}


def worst(statuses: Iterable[Status]) -> Status:
    """Return the worst status; ``"verified"`` if there are none."""
    return min(statuses, key=get_args(Status).index, default="verified")


# Reports -------------------------------------------------------------------------------------------------------------


def keep(outcome: Outcome, results: Path) -> bool:
    """Store the outcome of a bundle in a results folder, so that reports of this folder show its rows.

    Returns
    -------
    bool
        Whether it was stored: not if the bundle is false or cannot be read.
    """
    is_shown = outcome.status in ("verified", "claimed")
    if is_shown:
        text = json.dumps(outcome.to_plain(), sort_keys=True) + "\n"
        write_text(results / "bundles" / f"{outcome.digest}.json", text)
    return is_shown


def boards(results: Path) -> list[tuple[str, list[list[object]]]]:
    """Return heading and rows for each gallery, input, scorer and seed of the bundles in a results folder."""
    rows: dict[tuple[Any, ...], list[tuple[float, list[object]]]] = {}
    headings: dict[tuple[Any, ...], str] = {}
    for outcome in _read(results):
        for row in outcome.rows:
            place = (row.gallery, row.input, row.scorer, row.seed, row.gallery_digest)
            headings.setdefault(place, _heading(row))
            rows.setdefault(place, []).append((-row.scores["DCG"], _cells(outcome, row)))
    return [(headings[place], [cells for _, cells in sorted(rows[place])]) for place in sorted(rows)]


def _read(results: Path) -> Iterator[Outcome]:
    for path in sorted((results / "bundles").glob("*.json")):
        try:
            yield msgspec.convert(read_json(path.read_bytes()), Outcome)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{path} is not the outcome of a bundle", "remove it, and verify again") from error


def _heading(row: RowOutcome) -> str:
    by = f"scored by {row.scorer}" if row.scorer else "by descriptors"
    seed = f", seed {row.seed}" if row.seed else ""
    chance = ", ".join(f"{name} {number(row.chance[name])}" for name in PRINTED)
    return (
        f"{row.gallery}, {row.input}: {row.data_title}, {row.n_shapes} shapes, {row.n_classes} classes, {by}{seed}; "
        f"chance {chance}; digest of labels and inputs {row.gallery_digest[:12]}"
    )


def _cells(outcome: Outcome, row: RowOutcome) -> list[object]:
    scores = [f"{number(row.scores[name])} ({' to '.join(map(number, row.intervals[name]))})" for name in PRINTED]
    return [
        f"{outcome.title} ({outcome.method})", outcome.author, row.status, *scores, number(row.coverage),
        "" if row.seconds is None else f"{row.seconds:.3g}", "" if row.peak_mib is None else f"{row.peak_mib:.0f}",
        ", ".join(row.trained_on) or "nothing", _evidence(row), outcome.licence or "not stated", outcome.digest,
    ]  # fmt: skip


def _evidence(row: RowOutcome) -> str:
    """Return the evidence for the scores of a row, or its faults."""
    if row.faults:
        return "; ".join(f"{fault.name}: {fault.problem}" for fault in row.faults)
    recomputed = f"{len(row.again) or 'none'} recomputed"
    return f"from {row.holds}; {recomputed}; {_COMPARED.get(row.compared, 'labels and inputs not checked')}"
