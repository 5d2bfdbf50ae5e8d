"""What tables show of records: part of the data, row, block, scorer, seconds, and their tables.

All tables are pure functions of records, so they need neither data nor methods.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

from benchmark.datasets.changes import CHANGES
from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.records import EXTERNAL, Record
from benchmark.protocols.tables import (
    AGAINST,
    AVERAGED_PARAMETERS,
    NETWORK_PREFIXES,
    TABLES,
    Block,
    Table,
    own_table,
)
from benchmark.registry.names import base_name
from benchmark.report.notation import file_name


class DataChange(NamedTuple):
    """A change of a data set, as its name says it.

    Parameters
    ----------
    base
        Name of the unchanged set.
    kind, strength
        What was changed and how much, such as ``"noise"`` and ``"2"``.
    """

    base: str
    kind: str
    strength: str


def change_of(dataset: str) -> DataChange | None:
    """Return the last change in a name such as ``animals[noise=2]``; None for an unchanged set."""
    base, _, brackets = dataset.removesuffix("]").rpartition("[")
    kind, _, strength = brackets.partition("=")
    if kind not in CHANGES:
        return None
    return DataChange(base, kind, strength)


def by_gallery(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return records by the name of their gallery, in the order of the first of each."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.gallery, []).append(record)
    return groups


def of_newest_versions(records: Iterable[Record]) -> list[Record]:
    """Return the records that rank the newest version of the shapes of their gallery, in order.

    The newest one is with scores if any is, and a local one before a published one.
    """
    records = list(records)
    newest = {name: max(group, key=_newness) for name, group in by_gallery(records).items()}
    return [
        record
        for record in records
        if record.gallery_digest == newest[record.gallery].gallery_digest
    ]


def _newness(record: Record) -> tuple[bool, bool, str]:
    """Return what orders records by the version of the data that they decide for."""
    return record.status == "ok", not record.published, record.finished


def fold_of(record: Record) -> str:
    """Return the part of the data set that a record ranks, such as ``"fold 0"``.

    It is "" for all of it.
    """
    return record.gallery.removeprefix(record.data.name).removesuffix(" (quick)").strip()


def row_of(record: Record) -> str:
    """Return the name of the row of a record; see :func:`row_name`."""
    return row_name(record.method)


def row_name(method: str) -> str:
    """Return the name of a method without the parameters over which rows are averaged."""
    base, bracket, text = method.partition("[")
    parameters = text.removesuffix("]").split(",")
    kept = [part for part in parameters if not part.startswith(AVERAGED_PARAMETERS)]
    if bracket and any(kept):
        return f"{base}[{','.join(kept)}]"
    return base


def block_of(record: Record) -> Block:
    """Return the block of a record: a descriptor has no scorer, and a network has models."""
    if record.family == EXTERNAL:
        return "external"
    if not record.scorer:
        return "descriptor"
    if record.models or record.method.startswith(NETWORK_PREFIXES):
        return "network"
    return "form"


def chosen_records(
    records: Iterable[Record], *, quick: bool = False, scorer: str = DEFAULT_SCORER, seed: int = 0
) -> list[Record]:
    """Return the records of one scorer and seed, of quick runs or of full ones.

    Descriptors have no scorer, and stand beside all of them.
    """
    return [
        record
        for record in records
        if record.data.quick == quick and record.seed == seed and record.scorer in (scorer, "")
    ]


@dataclass(frozen=True)
class ScoredBy:
    """What tables say about the scorer and the seed of their records.

    Parameters
    ----------
    note
        A sentence for the notes; "" without a scorer.
    caption, suffix
        What captions and names of files add; "" for the default scorer and seed.
    options
        Options of a command that runs with this scorer and seed.
    """

    note: str
    caption: str
    suffix: str
    options: tuple[str, ...] = ()


def scored_by(records: Iterable[Record]) -> ScoredBy:
    """Return how a table names the scorer and the seed of its records.

    They are named in a note below the table and, unless they are the default ones, in the caption
    and in the names of files.
    """
    records = list(records)
    if not records:
        return ScoredBy("", "", "")
    # Records of descriptors have no scorer: they compare themselves.
    first = next((record for record in records if record.scorer), records[0])
    scorer = first.scorer
    title = first.scorer_title
    seed = records[0].seed
    caption = ""
    words = []  # in names of files
    options: list[str] = []
    details = ""
    if scorer not in ("", DEFAULT_SCORER):
        caption = f", scored by {title}"
        words += ["by", scorer]
        options += ["--scorer", scorer]
    if base_name(scorer) == DEFAULT_SCORER:
        details = " (three codebooks)"
    if seed:
        caption += f", seed {seed}"
        words += ["seed", str(seed)]
        options += ["--seed", str(seed)]
        details += f", seed {seed}"
    note = f"Scored by {title}{details}." if scorer else ""
    suffix = f"-{file_name('-'.join(words))}" if words else ""
    return ScoredBy(note, caption, suffix, tuple(options))


@cache
def tables_of(dataset: str, fold: str) -> tuple[Table, ...]:
    """Return the tables that show a part of a data set; a set that no table uses has its own."""
    of_data = [table for table in TABLES if table.shows(dataset) and not table.is_robustness]
    of_fold = tuple(table for table in of_data if fold in table.parts)
    others = of_fold
    if not fold.startswith(AGAINST):  # tables of queries alone are not enough for a whole set
        others = tuple(table for table in of_data if not table.is_cross)
    if others:
        return of_fold
    return (*of_fold, own_table(dataset, fold))


def seconds_of(record: Record, *, of_wall: bool = False) -> float | None:
    """Return the seconds a shape for form and geodesics; None if they were not measured.

    Parameters
    ----------
    record
        The record.
    of_wall
        Whether they are of the wall clock; by default they are of the processor.
    """
    seconds = record.seconds if of_wall else record.processor_seconds
    if "canonicalise" not in seconds or record.family == EXTERNAL:
        return None
    return seconds["canonicalise"] + seconds.get("geodesics", 0.0)
