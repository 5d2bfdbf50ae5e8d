"""What tables and frames show of records: their place, row, block, scorer and seconds.

All tables are pure functions of records, so they need neither data nor methods.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable
from functools import cache
from typing import NamedTuple

from benchmark.code_digest import digest_of_bytes
from benchmark.datasets.changes import CHANGES
from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.records import EXTERNAL, SUITE_RESULTS, Record
from benchmark.protocols.tables import AGAINST, AVERAGED, NETWORKS, TABLES, Kind, Table, own_table

BLANK = "--"


def hundredths(value: float | None) -> str:
    """Return a score with two decimals and no leading zero; halves, up to the six decimals of records, round up."""
    if value is None or math.isnan(value):
        return BLANK
    return f"{math.floor(round(value * 1e6) / 1e4 + 0.5) / 100:.2f}".removeprefix("0")


def changed(dataset: str) -> tuple[str, str, str] | None:
    """Return base, change and strength of the name of a changed set, such as ``animals[noise=2]``; None otherwise."""
    base, _, brackets = dataset.removesuffix("]").rpartition("[")
    change, _, strength = brackets.partition("=")
    return (base, change, strength) if change in CHANGES else None


def by_gallery(records: Iterable[Record]) -> dict[str, list[Record]]:
    """Return records by the name of their gallery, in the order of the first of each."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.gallery, []).append(record)
    return groups


def fold_of(record: Record) -> str:
    """Return the part of the data set that a record ranks, such as ``"fold 0"``; "" for the whole set."""
    return record.gallery.removeprefix(record.data.name).removesuffix(" (quick)").strip()


def row_of(record: Record) -> str:
    """Return the row of a record: its method, without what rows are averaged over."""
    base, bracket, parameters = record.method.partition("[")
    rest = [
        part for part in parameters.removesuffix("]").split(",") if not part.startswith(AVERAGED)
    ]
    return f"{base}[{','.join(rest)}]" if bracket and any(rest) else base


def kind_of(record: Record) -> Kind:
    """Return the block of a record: a descriptor has no scorer, and a network has models."""
    if record.family == EXTERNAL:
        return "external"
    if not record.scorer:
        return "descriptor"
    is_network = bool(record.models) or record.method.startswith(NETWORKS)
    return "network" if is_network else "form"


def chosen_records(
    records: Iterable[Record], *, quick: bool = False, scorer: str = DEFAULT_SCORER, seed: int = 0
) -> list[Record]:
    """Return the records that tables and comparisons show: of one scorer and seed; descriptors have no scorer."""
    return [
        record
        for record in records
        if record.data.quick == quick and record.seed == seed and record.scorer in (scorer, "")
    ]


def file_name(name: str, longest: int = 80) -> str:
    """Return a name as that of a file: where characters were lost, a digest tells it from others."""
    safe = re.sub(r"[^A-Za-z0-9._-]", "-", name)[:longest]
    return safe if safe == name else f"{safe.strip('-')}-{digest_of_bytes(name.encode())[:8]}"


class ScoredBy(NamedTuple):
    """Scorer and seed in a note, and what captions and names of files add if they are not the default ones."""

    note: str
    caption: str
    suffix: str


def scored_by(records: Iterable[Record]) -> ScoredBy:
    """Return what tables say about the scorer and the seed of their records."""
    every = [*records]
    named = next(((of.scorer, of.scorer_title) for of in every if of.scorer), ("", ""))
    is_default, seed = named[0] in ("", DEFAULT_SCORER), every[0].seed if every else 0
    seeds = f", seed {seed}" * bool(seed)
    draws = " (three codebooks)" * (named[0].partition("[")[0] == DEFAULT_SCORER)
    note = f"Scored by {named[1]}{draws}{seeds}." if named[0] else ""
    suffix = file_name(f"-by-{named[0]}" * (not is_default) + f"-seed-{seed}" * bool(seed))
    return ScoredBy(note, f", scored by {named[1]}" * (not is_default) + seeds, suffix)


@cache
def two_scorers() -> dict[tuple[str, str, str], dict[str, float]]:
    """Return published scores of methods on TOSCA by input, scorer and measure."""
    path = SUITE_RESULTS / "figures" / "two-scorers.csv"
    found: dict[tuple[str, str, str], dict[str, float]] = {}
    for line in csv.DictReader(
        path.read_text(encoding="utf-8").splitlines() if path.is_file() else ()
    ):
        of_measure = found.setdefault(
            (line.get("input", "mesh"), line["scorer"], line["measure"]), {}
        )
        of_measure[line["method"]] = float(line["value"])
    return found


@cache
def tables_of(dataset: str, fold: str) -> tuple[Table, ...]:
    """Return the tables that show a part of a data set; a set that no table uses has its own."""
    known = tuple(table for table in TABLES if table.shows(dataset) and not table.is_robustness)
    shown = tuple(table for table in known if fold in table.parts)
    has_own = not shown if fold.startswith(AGAINST) else all(table.is_cross for table in known)
    return (*shown, own_table(dataset, fold)) if has_own else shown


def seconds_of(record: Record, *, of_wall: bool = False) -> float | None:
    """Return the seconds a shape for form and geodesics, of processor or wall; None if they were not measured."""
    seconds = record.seconds if of_wall else record.processor_seconds
    if "canonicalise" not in seconds or record.family == EXTERNAL:
        return None
    return seconds["canonicalise"] + seconds.get("geodesics", 0.0)
