"""Tell data sets of one name apart: folders at different paths."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Sequence, Set
from pathlib import Path, PurePath

import msgspec

from benchmark.datasets.catalogue import is_known, is_path
from benchmark.datasets.changes import split_changes
from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Data, Record
from benchmark.text import printable


def path_of(source: str) -> str:
    """Return a source with the absolute path of its folder; "" for a set of the suite."""
    base, _ = split_changes(source)
    is_folder = is_path(base) and not is_known(base)
    return printable(f"{os.path.realpath(base)}{source[len(base) :]}") if is_folder else ""


def label_data_sets(records: Sequence[Record]) -> list[Record]:
    """Return records whose data sets, if they share a name, are called by as much of their paths as it takes."""
    paths = defaultdict[str, set[str]](set)
    for record in records:
        paths[record.data.name].add(record.data.path)
    return [_called(record, _label(record.data, paths[record.data.name])) for record in records]


def records_of(records: Sequence[Record], words: Iterable[str]) -> list[Record]:
    """Return the labelled records of data sets, each given by its name, its label, or its path.

    Raises
    ------
    ConfigurationError
        If a word names several data sets: a folder here and one elsewhere, or two of one name.
    """
    chosen = set[int]()
    for word in words:
        base, _ = split_changes(word)
        path = path_of(word) if Path(base).exists() else ""
        here = [record for record in records if path and record.data.path == path]
        is_name = not (here and "/" in word)
        named = [
            record
            for record in records
            if is_name and word in _words(record) and record not in here
        ]
        several = [*dict.fromkeys(filter(None, [path, *(record.data.path for record in named)]))]
        if named and len(several) > 1:
            problem = f"'{word}' names results of {' and of '.join(several)}"
            raise ConfigurationError(problem, "pass the path that you mean")
        chosen |= {id(record) for record in (*here, *named)}
    return [record for record in records if id(record) in chosen]


def _label(data: Data, paths: Set[str]) -> str:
    others = paths - {data.path}
    return _shortest(data.name, data.path, others) if data.path and others else data.name


def _shortest(name: str, path: str, others: Iterable[str]) -> str:
    """Return the shortest end of a path, in whole folders and with the name at its end, that no other path has."""
    folders, ends = PurePath(path).parent.parts, [PurePath(other).parent.parts for other in others]
    for count in range(1, len(folders) + 1):
        if all(end[-count:] != folders[-count:] for end in ends):
            return "/".join([*(part.strip("/") for part in folders[-count:]), name])
    return path


def _called(record: Record, label: str) -> Record:
    name = record.data.name
    if label == name:
        return record
    gallery = label + record.gallery.removeprefix(name)
    return msgspec.structs.replace(
        record, gallery=gallery, data=msgspec.structs.replace(record.data, name=label)
    )


def _words(record: Record) -> tuple[str, ...]:
    """Return what a data set is called: its name or label, also without folders, and its paths."""
    data = record.data
    return data.name, PurePath(data.name).name, data.path or data.source
