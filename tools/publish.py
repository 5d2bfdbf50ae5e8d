"""Publish records of jobs done here, into RESULTS/records, which is committed: python -m tools.publish [RESULTS]."""

from __future__ import annotations

import os
import re
import sys
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial.distance import squareform

from benchmark.code_digest import digest_of_bytes
from benchmark.datasets.catalogue import CATALOGUE
from benchmark.datasets.official import SETS
from benchmark.defaults import DATA_VARIABLE
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.files import write_atomically
from benchmark.pipeline.cache import storing
from benchmark.pipeline.environment import has_edits
from benchmark.pipeline.records import (
    Record,
    encode_record,
    published_distances,
    read_distances,
    read_records,
    say_skipped,
    scan_files,
)
from benchmark.protocols.tables import PARTS
from benchmark.reference.paper import MEASURES
from benchmark.registry import BUILT_IN, SCORERS
from benchmark.report.drawing import OBLIQUE, shaded, webp
from benchmark.report.forms import StoredForms, thumbnail
from benchmark.report.frames import row_of
from benchmark.text import LONGEST_NAME

#: Data set whose distances are published, of surfaces and of views.
WITH_DISTANCES = "tosca"

#: Pixels of the picture of a form of a row.
THUMBNAIL = 96


def publish(results: Path) -> list[Record]:
    """Write the public records made here in place of earlier ones of their rows, and return those that are new.

    Raises
    ------
    ConfigurationError
        If the working tree has changes, the records of a gallery and input were made at several
        commits, or a published line cannot be read.
    """
    if has_edits():
        raise ConfigurationError("the working tree has changes", "commit them, and run again")
    here = [record for record in read_records(results, published=False) if is_public(record)]
    commits = defaultdict[str, set[str]](set)
    for record in here:
        commits[f"{record.gallery} {record.input}"].add(record.commit)
    for name, made_at in commits.items():
        if len(made_at) > 1 or any(commit.endswith("+") for commit in made_at):
            problem = f"the rows of {name} were made at {', '.join(sorted(made_at))}"
            raise ConfigurationError(problem, "run them again at one commit")
    published = scan_files((results / "records").glob("*.jsonl"))
    say_skipped(published.skipped)
    if published.skipped:
        problem = f"{len(published.skipped)} lines of {results / 'records'} cannot be read"
        raise ConfigurationError(problem, "do with each what is said above, and run again")
    before = {record.row: portable(record) for record in published.records}
    now = before | {record.row: with_distances(results, portable(record)) for record in here}
    write_published(results, now.values())
    kept = {published_distances(results, record.distances) for record in now.values()}
    for file in {*published_distances(results, "").parent.glob("*")} - kept:
        file.unlink()
    write_thumbnails(results, here)
    return [record for row, record in now.items() if record != before.get(row)]


def is_public(record: Record) -> bool:
    """Return whether a record means something elsewhere: a full run of a set, a method and a scorer of the suite."""
    is_whole = record.gallery.removeprefix(record.data.name).strip() in PARTS
    is_known = (
        record.data.name.partition("[")[0] in CATALOGUE
        and record.method.partition("[")[0] in BUILT_IN
    )
    is_known &= record.scorer in ("", *SCORERS)
    return is_whole and is_known and record.status != "unavailable"


def portable(record: Record) -> Record:
    """Return a record without what means nothing on another machine."""
    per_query = {name: values for name, values in record.per_query.items() if name in MEASURES}
    published = {
        "per_query": per_query,
        "parts": {},
        "traceback": "",
        "merged_from": None,
        "published": False,
    }
    return msgspec.structs.replace(record.without_files(), **published)


def with_distances(results: Path, record: Record) -> Record:
    """Return a record with the digest of its distances, which are written for the public if they belong to TOSCA."""
    is_shown = record.data.name == WITH_DISTANCES and not record.gallery_of_queries
    distances = read_distances(results, record) if is_shown else None
    if distances is None or not np.array_equal(distances, distances.T):
        return record
    content = squareform(distances).astype("<f4").tobytes()
    digest = digest_of_bytes(content)
    with storing(results):
        write_atomically(published_distances(results, digest), lambda file: file.write(content))
    return msgspec.structs.replace(record, distances=digest)


def write_published(results: Path, records: Iterable[Record]) -> None:
    """Write records as lines, a file for each data set, in the order of their rows."""
    files = defaultdict[str, bytes](bytes)
    for record in sorted(records, key=lambda record: record.row):
        base = (
            re.sub("[^A-Za-z0-9-]+", "-", record.data.name.partition("[")[0])[:LONGEST_NAME]
            or "records"
        )
        files[f"{base}.jsonl"] += encode_record(record) + b"\n"
    folder = results / "records"
    with storing(results):
        for name, text in files.items():
            write_atomically(folder / name, lambda file, text=text: file.write(text), durable=True)  # type: ignore[misc]


def has_pictures(record: Record) -> bool:
    """Return whether pictures of the forms of a record may be published."""
    official = SETS.get(record.data.name.partition("[")[0])
    return official is None or official.pictures


def write_thumbnails(results: Path, records: Iterable[Record]) -> None:
    """Write a picture of a form of each row whose forms are stored, of complete surfaces where it has both.

    Sets whose terms allow no pictures have none.
    """
    forms, drawn = StoredForms(results, Path(os.environ.get(DATA_VARIABLE, "."))), set[Path]()
    shown = [record for record in records if has_pictures(record)]
    for record in sorted(shown, key=lambda record: (record.input, record.row)):
        file = thumbnail(results, record.data.name, row_of(record))
        form = (
            forms.form(record, record.shapes[record.answered[0]])
            if record.answered and file not in drawn
            else None
        )
        if form:
            data = webp(shaded(form.mesh, OBLIQUE, THUMBNAIL, form.values), quality=40)
            write_atomically(file, lambda target, data=data: target.write(data))  # type: ignore[misc]
            drawn.add(file)


if __name__ == "__main__":
    try:
        print(f"{len(publish(Path((*sys.argv[1:], 'results')[0])))} records are new")
    except BenchmarkError as error:
        sys.exit(f"error: {error}")
