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
    if not is_folder:
        return ""
    changes = source[len(base) :]
    return printable(os.path.realpath(base) + changes)


def label_data_sets(records: Sequence[Record]) -> list[Record]:
    """Return records whose data sets have different names.

    Data sets that share a name are called by as much of their paths as tells them apart.
    """
    paths: defaultdict[str, set[str]] = defaultdict(set)
    for record in records:
        paths[record.data.name].add(record.data.path)
    return [_renamed(record, _label(record.data, paths[record.data.name])) for record in records]


def records_of(records: Sequence[Record], words: Iterable[str]) -> list[Record]:
    """Return the labelled records of data sets, each given by its name, its label, or its path.

    Raises
    ------
    ConfigurationError
        If a word names several data sets: a folder here and one elsewhere, or two of one name.
    """
    chosen: set[int] = set()
    for word in words:
        chosen |= {id(record) for record in _records_of_word(records, word)}
    return [record for record in records if id(record) in chosen]


def _records_of_word(records: Sequence[Record], word: str) -> list[Record]:
    """Return the records of the data set that a user's word means.

    Parameters
    ----------
    records
        The records.
    word
        Name of a data set, or path of a folder, such as ``"tosca"`` or ``"./scans"``.

    Raises
    ------
    ConfigurationError
        If it means several data sets, such as two folders of one name.
    """
    # Records that were computed from the folder of this path, if there is one.
    folder, _ = split_changes(word)
    path = path_of(word) if Path(folder).exists() else ""
    of_folder = [record for record in records if path and record.data.path == path]

    # Records of other data of this name, unless the word is clearly a path.
    of_name: list[Record] = []
    is_path_of_data = bool(of_folder) and "/" in word
    if not is_path_of_data:
        of_name = [
            record for record in records if word in _words(record) and record not in of_folder
        ]

    paths = [path, *(record.data.path for record in of_name)]
    different_paths = list(dict.fromkeys(filter(None, paths)))
    if of_name and len(different_paths) > 1:
        problem = f"'{word}' names results of {' and of '.join(different_paths)}"
        raise ConfigurationError(problem, "pass the path that you mean")
    return [*of_folder, *of_name]


def _label(data: Data, paths: Set[str]) -> str:
    """Return what a data set is called beside those of the same name at other paths."""
    others = paths - {data.path}
    if not data.path or not others:
        return data.name
    return _shortest(data.name, data.path, others)


def _shortest(name: str, path: str, others: Iterable[str]) -> str:
    """Return the shortest end of a path that no other path has: whole folders, and the name."""
    folders = PurePath(path).parent.parts
    other_folders = [PurePath(other).parent.parts for other in others]
    for count in range(1, len(folders) + 1):
        end = folders[-count:]
        if all(other[-count:] != end for other in other_folders):
            return "/".join([*(folder.strip("/") for folder in end), name])
    return path


def _renamed(record: Record, label: str) -> Record:
    """Return a record whose data set and gallery have another name."""
    name = record.data.name
    if label == name:
        return record
    gallery = label + record.gallery.removeprefix(name)
    data = msgspec.structs.replace(record.data, name=label)
    return msgspec.structs.replace(record, gallery=gallery, data=data)


def _words(record: Record) -> tuple[str, ...]:
    """Return what a data set is called: its name or label, also without folders, and its path."""
    data = record.data
    return data.name, PurePath(data.name).name, data.path or data.source
