"""Delete results, and files that no record names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from benchmark.commands.selection import RESULTS, as_sets, as_texts, is_of_methods
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import storing, writing
from benchmark.pipeline.data_names import label_data_sets, records_of
from benchmark.pipeline.record_files import local_files, local_folder, read_records, unneeded
from benchmark.pipeline.records import Record
from benchmark.registry import are_named
from benchmark.registry.names import base_name
from benchmark.text import counted, listed


@dataclass(frozen=True)
class Forgotten:
    """What was deleted, or would be.

    Parameters
    ----------
    records
        The records.
    files
        The files, of records and of the cache.
    size
        Bytes of the files.
    """

    records: tuple[Record, ...]
    files: tuple[Path, ...]
    size: int

    def __str__(self) -> str:
        """Return how many records and forms these are, and their size."""
        json_files = [path for path in self.files if path.suffix == ".json"]
        n_records = sum(path.parent.name == "records" for path in json_files)
        n_forms = sum(path.parent.name == "forms" for path in self.files)
        numbers = f"{counted(n_records, 'record')}, {counted(n_forms, 'form')}"
        return f"{numbers}, {self.size / 1e6:.1f} MB"


def forget(
    methods: str | Iterable[str] = (),
    data: str | Path | Iterable[str | Path] = (),
    *,
    records: str | Iterable[str] = (),
    unused: bool = False,
    results: str | Path = RESULTS,
    yes: bool = False,
) -> Forgotten:
    """Delete selected records, and all files that none of the other records needs.

    Select by method and data set, by record, or select only files. A file that cannot be read as a
    record is kept, and so are the files that it names, unless ``records`` names it.

    Parameters
    ----------
    methods, data
        Names of methods, and names or folders of data sets, whose records are deleted. If both are
        given, those of these methods on these data sets are.
    records
        Single records to delete, each by its row or by the name of its file without ``.json``.
    unused
        Delete no record, only files that no record needs.
    results
        The results folder.
    yes
        Whether to delete. By default nothing is deleted, and the result says what would be.

    Returns
    -------
    Forgotten
        The records and files that were deleted, or would be.

    Raises
    ------
    ConfigurationError
        If not exactly one way to select is used, or the selection, or a name in it, fits no record.
    """
    folder = Path(results)
    selected_methods = as_texts(methods)
    selected_sets = as_texts(data)
    selected_records = as_texts(records)
    has_selection = bool(selected_methods or selected_sets)
    n_ways = [has_selection, bool(selected_records), unused].count(True)
    if n_ways != 1:
        raise ConfigurationError(
            "one selection is needed",
            "name methods with -m or data sets with -d, name records with --record, or pass "
            "--unused",
        )
    # A selection that is wrong changes nothing in the folder, which need not exist.
    all_records = read_records(folder, published=False)
    _check_known(folder, all_records, selected_records)
    selected_keys: set[str] = set()
    if has_selection:
        selected_keys = _keys_of_selection(all_records, selected_methods, selected_sets)
        if selected_keys:
            _check_are_of_records(folder, all_records, selected_methods, selected_sets)

    if not local_folder(folder).is_dir():
        problem = f"{folder} holds no results of runs"
        raise ConfigurationError(problem, "name a results folder with --results")
    with writing(folder):  # no run may add files meanwhile
        unwanted, files = unneeded(
            folder, lambda record: record.key in selected_keys, selected_records
        )
        if has_selection and not unwanted:
            problem = f"no record under {folder} fits the selection"
            known = sorted({record.method for record in all_records})
            raise ConfigurationError(problem, f"there are {', '.join(known) or 'no records'}")
        size = sum(path.stat().st_size for path in files)
        if yes:
            _delete(files, folder)
    return Forgotten(tuple(unwanted), tuple(files), size)


def _delete(files: Iterable[Path], folder: Path) -> None:
    """Delete files of a results folder; raise ``StorageError`` if one cannot be deleted."""
    with storing(folder):
        for path in files:
            path.unlink(missing_ok=True)


def _keys_of_selection(
    records: Sequence[Record], methods: Sequence[str], data: Sequence[str]
) -> set[str]:
    """Return the keys of the records of some methods on some data sets; of all where none is named.

    Parameters
    ----------
    records
        All records.
    methods
        Names of methods.
    data
        Names or folders of data sets.
    """
    selected = label_data_sets(records)
    if data:
        selected = records_of(selected, as_sets(data))
    if are_named(methods):
        selected = [record for record in selected if is_of_methods(record, methods)]
    return {record.key for record in selected}


def _check_are_of_records(
    folder: Path, records: Sequence[Record], methods: Sequence[str], data: Sequence[str]
) -> None:
    """Raise ``ConfigurationError`` if no record is of one of some methods or data sets.

    For the parameters, see :func:`_keys_of_selection`.
    """
    labelled = label_data_sets(records)
    unknown = [name for name in data if not records_of(labelled, as_sets([name]))]
    if are_named(methods):
        known = {record.method for record in records}
        known |= set(map(base_name, known))
        unknown += [method for method in methods if method not in known]
    if unknown:
        problem = f"no record under {folder} is of {listed(unknown)}"
        raise ConfigurationError(problem, "correct the name, or leave it out")


def _check_known(folder: Path, every: Sequence[Record], named: Sequence[str]) -> None:
    """Check that each name of a record is that of one in the folder.

    Raises
    ------
    ConfigurationError
        If it is that of none, or a row of several data sets, which may be folders of one name.
    """
    known = {path.stem for path in local_files(folder)} | {str(record.row) for record in every}
    unknown = {*named} - known
    if unknown:
        problem = f"there is no record '{min(unknown)}' under {folder}"
        hint = "name a row as 'plan' and 'merge' do, or a file of runs/records without '.json'"
        raise ConfigurationError(problem, hint)
    for name in named:
        rows = [record.row for record in every if str(record.row) == name]
        if len(rows) > 1:
            paths = ", ".join(filter(None, chain.from_iterable(row.paths for row in rows)))
            problem = f"'{name}' names rows of several data sets: {paths}"
            raise ConfigurationError(problem, "pass the key of a record instead")
