"""Rows of bundles for the first page of a report: what was verified, and what is claimed, gallery by gallery."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmark.bundles.outcome import Outcome, RowOutcome
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.report.rounding import number
from retrieval.measures import PRINTED

_COMPARED = {"data": "labels and inputs compared with the data", "records": "labels and inputs as in records"}


def keep(outcome: Outcome, results: Path) -> None:
    """Keep what was found of a bundle in a results folder, whose reports show its rows.

    Raises
    ------
    ConfigurationError
        If it is false or cannot be read.
    """
    if outcome.status not in ("verified", "claimed"):
        raise ConfigurationError(f"the bundle is {outcome.status}: no report shows it", "omit --into")
    write_text(results / "bundles" / f"{outcome.digest}.json", json.dumps(outcome.to_plain(), sort_keys=True) + "\n")


def boards(results: Path) -> list[tuple[str, list[list[object]]]]:
    """Return heading and rows for each gallery, input, scorer and seed of the bundles that a results folder keeps."""
    rows: dict[tuple[Any, ...], list[tuple[float, list[object]]]] = {}
    first: dict[tuple[Any, ...], RowOutcome] = {}
    for outcome in _kept(results):
        for row in outcome.rows:
            place = (row.gallery, row.input, row.scorer, row.seed, row.gallery_digest)
            first.setdefault(place, row)
            rows.setdefault(place, []).append((-row.scores["DCG"], _cells(outcome, row)))
    return [(_heading(first[place]), [cells for _, cells in sorted(rows[place])]) for place in sorted(rows)]


def _kept(results: Path) -> Iterator[Outcome]:
    for path in sorted((results / "bundles").glob("*.json")):
        try:
            yield Outcome.from_plain(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{path} is no outcome of a bundle", "remove it, and verify again") from error


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
    """Return where the scores of a row come from, or why nobody can tell."""
    if row.faults:
        return "; ".join(f"{fault.name}: {fault.problem}" for fault in row.faults)
    again = f"{len(row.again) or 'none'} made again"
    return f"from {row.holds}; {again}; {_COMPARED.get(row.compared, 'labels and inputs as told')}"
