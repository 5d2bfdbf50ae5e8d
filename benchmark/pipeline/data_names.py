"""Tell data sets of one name apart: folders and plugin files with different contents at different paths."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath

import msgspec

from benchmark.datasets.base import printable
from benchmark.datasets.catalogue import is_known, is_path
from benchmark.datasets.changes import split_name
from benchmark.datasets.own import is_own
from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record


def path_of(source: str) -> str:
    """Return a source with the absolute path of its folder or plugin file; "" for a set of the suite."""
    base, _ = split_name(source)
    file, colon, variable = base.rpartition(":") if is_own(base) else (base, "", "")
    if colon or (is_path(base) and not is_known(base)):
        return printable(f"{os.path.realpath(file)}{colon}{variable}{source[len(base) :]}")
    return ""


def label_data_sets(records: Sequence[Record]) -> list[Record]:
    """Return records whose data sets, if they share a name, are called by as much of their paths as it takes."""
    sets: dict[str, list[_DataSet]] = {}
    for record in records:
        _add(sets.setdefault(record.data.name, []), record)
    labels: dict[int, str] = {}
    for name, of_name in sets.items():
        for place, one in enumerate(of_name):
            others = [path for other in of_name[:place] + of_name[place + 1 :] for path in other.paths]
            label = _shortest(name, one.paths[-1], others) if others and one.paths else name
            labels |= {id(record): label for record in one.records}
    return [_called(record, labels[id(record)]) for record in records]


def records_of(records: Sequence[Record], words: Iterable[str]) -> list[Record]:
    """Return the labelled records of data sets, each given by its name, its label, or its path.

    Raises
    ------
    ConfigurationError
        If a word names several data sets: a folder here and one elsewhere, or two of one name.
    """
    chosen = set[int]()
    for word in words:
        base, _ = split_name(word)
        path = path_of(word) if is_own(base) or Path(base).exists() else ""
        contents = {record.content for record in records if path and path in record.data.paths}
        here = [record for record in records if record.content in contents]  # also those of a colleague
        is_name = not (here and "/" in word)
        named = [record for record in records if is_name and word in _words(record) and record not in here]
        several = [path, *(record.data.paths[-1] for record in named if record.data.paths)]
        if named and len(several := [*dict.fromkeys(filter(None, several))]) > 1:
            problem = f"'{word}' names results of {' and of '.join(several)}"
            raise ConfigurationError(problem, "pass the path that you mean")
        chosen |= {id(record) for record in (*here, *named)}
    return [record for record in records if id(record) in chosen]


class _DataSet(msgspec.Struct):
    """Records of one data set, where it was found, and the contents of its galleries."""

    records: list[Record]
    paths: list[str]
    contents: set[tuple[str, ...]]


def _add(sets: list[_DataSet], record: Record) -> None:
    """Add a record to the data sets of its name, of which it may join several."""
    merged = _DataSet([record], [*record.data.paths], {(record.gallery, *record.content)})
    for other in [*sets]:
        is_same = set(other.paths) & set(merged.paths) or not (other.paths or merged.paths)
        if is_same or other.contents & merged.contents:
            sets.remove(other)
            paths = [*dict.fromkeys([*other.paths, *merged.paths])]
            merged = _DataSet([*other.records, *merged.records], paths, other.contents | merged.contents)
    sets.append(merged)


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
    return msgspec.structs.replace(record, gallery=gallery, data=msgspec.structs.replace(record.data, name=label))


def _words(record: Record) -> tuple[str, ...]:
    """Return what a data set is called: its name or label, also without folders, and its paths."""
    data = record.data
    return data.name, PurePath(data.name).name, *(data.paths or [data.source])
