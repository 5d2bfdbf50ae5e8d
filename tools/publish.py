"""Publish records of jobs done here in RESULTS/records: ``python -m tools.publish [RESULTS]``."""

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
from benchmark.pipeline.record_arrays import published_distances, read_distances
from benchmark.pipeline.record_files import encode_record, read_records, say_skipped, scan_files
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import PARTS, TABLE_MEASURES
from benchmark.registry import BUILT_IN, SCORERS
from benchmark.registry.names import base_name
from benchmark.report.drawing import OBLIQUE, shaded, webp
from benchmark.report.forms import StoredForms, thumbnail
from benchmark.report.record_facts import row_of
from benchmark.text import LONGEST_NAME

#: Data set whose distances are published, of surfaces and of views.
WITH_DISTANCES = "tosca"

#: Pixels of the picture of a form of a row.
THUMBNAIL = 96


def publish(results: Path) -> list[Record]:
    """Write the public records made here in place of earlier ones, and return those that are new.

    Raises
    ------
    ConfigurationError
        If the working tree has changes, the records of a gallery and input were made at several
        commits, or a published line cannot be read.
    """
    if has_edits():
        raise ConfigurationError("the working tree has changes", "commit them, and run again")
    here = [record for record in read_records(results, published=False) if is_public(record)]
    _check_commits(here)
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


def _check_commits(records: Iterable[Record]) -> None:
    """Raise ``ConfigurationError`` if the records of a gallery and input are of several commits."""
    commits = defaultdict[str, set[str]](set)
    for record in records:
        commits[f"{record.gallery} {record.input}"].add(record.commit)
    for name, made_at in commits.items():
        if len(made_at) > 1 or any(commit.endswith("+") for commit in made_at):
            problem = f"the rows of {name} were made at {', '.join(sorted(made_at))}"
            raise ConfigurationError(problem, "run them again at one commit")


def is_public(record: Record) -> bool:
    """Return whether a record is a full run of a set, a method and a scorer of the suite."""
    is_whole = record.gallery.removeprefix(record.data.name).strip() in PARTS
    is_known = (
        base_name(record.data.name) in CATALOGUE
        and base_name(record.method) in BUILT_IN
        and record.scorer in ("", *SCORERS)
    )
    return is_whole and is_known and record.status != "unavailable"


def portable(record: Record) -> Record:
    """Return a record without what means nothing on another machine."""
    per_query = {
        name: values for name, values in record.per_query.items() if name in TABLE_MEASURES
    }
    published = {
        "per_query": per_query,
        "parts": {},
        "traceback": "",
        "merged_from": None,
        "published": False,
    }
    return msgspec.structs.replace(record.without_files(), **published)


def with_distances(results: Path, record: Record) -> Record:
    """Return a record with the digest of its distances, which are written if they are public."""
    if record.data.name != WITH_DISTANCES or record.gallery_of_queries:
        return record
    distances = read_distances(results, record)
    if distances is None or not np.array_equal(distances, distances.T):
        return record
    content = squareform(distances).astype("<f4").tobytes()
    digest = digest_of_bytes(content)
    with storing(results):
        _write(published_distances(results, digest), content)
    return msgspec.structs.replace(record, distances=digest)


def write_published(results: Path, records: Iterable[Record]) -> None:
    """Write records as lines, a file for each data set, in the order of their rows."""
    files = defaultdict[str, bytes](bytes)
    for record in sorted(records, key=lambda record: record.row):
        name = re.sub("[^A-Za-z0-9-]+", "-", base_name(record.data.name))[:LONGEST_NAME]
        files[f"{name or 'records'}.jsonl"] += encode_record(record) + b"\n"
    with storing(results):
        for name, lines in files.items():
            _write(results / "records" / name, lines, durable=True)


def _write(path: Path, content: bytes, *, durable: bool = False) -> None:
    """Write a file in one step."""
    write_atomically(path, lambda file: file.write(content), durable=durable)


def has_pictures(record: Record) -> bool:
    """Return whether pictures of the forms of a record may be published."""
    official = SETS.get(base_name(record.data.name))
    return official is None or official.pictures


def write_thumbnails(results: Path, records: Iterable[Record]) -> None:
    """Write a picture of a form of each row whose forms are stored, if possible of surfaces.

    Sets whose terms allow no pictures have none.
    """
    forms = StoredForms(results, Path(os.environ.get(DATA_VARIABLE, ".")))
    drawn = set[Path]()
    of_sets = [record for record in records if record.answered and has_pictures(record)]
    for record in sorted(of_sets, key=lambda record: (record.input, record.row)):
        file = thumbnail(results, record.data.name, row_of(record))
        if file in drawn:
            continue
        form = forms.form(record, record.shapes[record.answered[0]])
        if form:
            picture = shaded(form.mesh, OBLIQUE, THUMBNAIL, form.values)
            _write(file, webp(picture, quality=40))
            drawn.add(file)


if __name__ == "__main__":
    try:
        folder = sys.argv[1] if len(sys.argv) > 1 else "results"
        print(f"{len(publish(Path(folder)))} records are new")
    except BenchmarkError as error:
        sys.exit(f"error: {error}")
