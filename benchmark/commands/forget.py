"""Delete results, and files that no record names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.commands.selection import RESULTS, as_list, is_of_methods
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import storing, writing
from benchmark.pipeline.data_names import label_data_sets, records_of
from benchmark.pipeline.record_files import local_files, read_records, unneeded
from benchmark.pipeline.records import Record
from benchmark.registry import are_named


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
        n_records = sum(path.suffix == ".json" for path in self.files)
        n_forms = sum(path.parent.name == "forms" for path in self.files)
        return f"{n_records} records, {n_forms} forms, {self.size / 1e6:.1f} MB"


def forget(
    methods: str | Sequence[str] = (),
    data: str | Path | Sequence[str | Path] = (),
    *,
    records: Sequence[str] = (),
    unused: bool = False,
    results: str | Path = RESULTS,
    yes: bool = False,
) -> Forgotten:
    """Delete the results of methods or data sets, and all files that no remaining record needs.

    A record that cannot be read stays, with the files that it names, unless ``records`` names it.

    Parameters
    ----------
    methods, data
        Names of methods, and names or folders of data sets, whose results go.
    records
        Rows, or names of files without ``.json``, of the records that go.
    unused
        Whether to select no record, so that only files go that no record needs.
    results
        The results folder.
    yes
        Whether to delete; by default, the result says what would be deleted.

    Returns
    -------
    Forgotten
        What was deleted, or would be.

    Raises
    ------
    ConfigurationError
        If nothing or too much is selected, or nothing fits.
    """
    folder = Path(results)
    has_selection = bool(as_list(methods) or data)
    n_ways = [has_selection, bool(records), unused].count(True)
    if n_ways != 1:
        raise ConfigurationError(
            "one selection is needed",
            "name methods with -m or data sets with -d, name records with --record, or pass "
            "--unused",
        )
    all_records = read_records(folder, published=False)
    _check_known(folder, all_records, records)
    selected_keys: set[str] = set()
    if has_selection:
        selected_keys = _keys_of_selection(all_records, as_list(methods), as_list(data))

    with writing(folder):  # no run may add files meanwhile
        unwanted, files = unneeded(folder, lambda record: record.key in selected_keys, records)
        if has_selection and not unwanted:
            problem = f"no record under {folder} fits the selection"
            known = sorted({record.method for record in all_records})
            raise ConfigurationError(problem, f"there are {', '.join(known) or 'no records'}")
        size = sum(path.stat().st_size for path in files)
        if yes:
            with storing(folder):
                for path in files:
                    path.unlink(missing_ok=True)
    return Forgotten(tuple(unwanted), tuple(files), size)


def _keys_of_selection(
    records: Sequence[Record], methods: Sequence[str], data: Sequence[str | Path]
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
        selected = records_of(selected, [str(name) for name in data])
    if are_named(methods):
        selected = [record for record in selected if is_of_methods(record, methods)]
    return {record.key for record in selected}


def _check_known(folder: Path, every: Sequence[Record], named: Sequence[str]) -> None:
    """Raise ``ConfigurationError`` if a record that is named is not in the folder."""
    known = {path.stem for path in local_files(folder)} | {str(record.row) for record in every}
    unknown = {*named} - known
    if unknown:
        problem = f"there is no record '{min(unknown)}' under {folder}"
        hint = "name a row as 'plan' and 'merge' do, or a file of runs/records without '.json'"
        raise ConfigurationError(problem, hint)
