"""The tables of the paper as data: which set, which shapes, which rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmark.contracts import Input
from benchmark.datasets.base import Dataset, Entry, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, is_path, is_present, open_dataset
from benchmark.errors import ConfigurationError, did_you_mean

INPUTS: tuple[Input, ...] = ("mesh", "view")

#: ``--quick`` keeps every k-th pose so that no subject keeps more than this many.
QUICK_POSES = 5


@dataclass(frozen=True)
class Table:
    """One table.

    Parameters
    ----------
    identifier
        The paper's numeral, or the name of a data set for a table of one's own.
    caption
        What the table shows, without naming the data.
    dataset
        Name or path of the set that the paper uses.
    stand_in
        Generated set that takes its place when it is absent; "" if there is none.
    subjects
        Subjects in the gallery, by their place in the data set; empty for all.
    in_quick_runs
        Whether ``--quick`` makes it without being asked for it by name.
    """

    identifier: str
    caption: str
    dataset: str
    stand_in: str = ""
    subjects: tuple[int, ...] = ()
    in_quick_runs: bool = True


#: Subjects 0-9 are for training, 10-14 for testing; the paper tells the numbers of subjects but not which.
TEST_SUBJECTS = tuple(range(10, 15))

TABLES: tuple[Table, ...] = (
    Table("I", "Retrieval of synthetic humans, test subjects only", "shrec14-synthetic", "humans", TEST_SUBJECTS),
    Table("II", "Retrieval of real humans", "shrec14-real", "humans-scanlike", in_quick_runs=False),
    Table("III", "Retrieval of animals and people", "tosca", "animals"),
)

#: Tables of the paper that cannot be made yet, with the reason.
PENDING = {
    "IV": "ablates the learned network, which is not built yet",
}


@dataclass(frozen=True)
class Gallery:
    """The shapes that one table ranks against each other.

    Parameters
    ----------
    table
        The table.
    source
        Name or path by which the set is opened again in another process.
    dataset
        The set that is used: the paper's or its stand-in.
    entries
        The shapes, in matrix order.
    quick
        Whether poses were left out to save time.
    """

    table: Table
    source: str
    dataset: Dataset
    entries: tuple[Entry, ...]
    quick: bool = False

    @property
    def name(self) -> str:
        """Name of the gallery in plans and records."""
        return f"{self.dataset.name}{' (quick)' if self.quick else ''}"


def galleries(
    table_names: Iterable[str] = (),
    dataset_names: Iterable[str] = (),
    data_root: Path | None = None,
    quick: bool = False,
) -> list[Gallery]:
    """Choose the galleries that a selection on the command line stands for.

    The paper's set is used when it is present and its stand-in otherwise, never both in one table.

    Parameters
    ----------
    table_names
        Numerals of tables; empty for all.
    dataset_names
        Names of data sets or paths of folders; empty for those of the tables. A set that no table uses gets a table
        of its own.
    data_root
        The folder that holds the official sets.
    quick
        Keep at most :data:`QUICK_POSES` poses of each subject.

    Raises
    ------
    ConfigurationError
        If a name is unknown or the selection is empty.
    DatasetError
        If a named set is absent or not fit for retrieval.
    """
    known = {table.identifier: table for table in TABLES}
    wanted_tables, wanted_sets = list(table_names), list(dataset_names)
    for name in wanted_tables:
        if name in PENDING:
            raise ConfigurationError(f"table {name} cannot be made: {PENDING[name]}", f"choose from {', '.join(known)}")
        if name not in known:
            raise did_you_mean("table", name, known)
    made = [name for name, table in known.items() if table.in_quick_runs or not quick]
    chosen = [(known[name], _source(known[name], data_root)) for name in wanted_tables or made]
    if wanted_sets:
        own = [(_table_of(name, known), name) for name in wanted_sets]
        chosen = [(table, name) for table, name in own if not wanted_tables or table.identifier in wanted_tables]
        if not chosen:
            raise ConfigurationError(
                f"no selected table uses {', '.join(wanted_sets)}", "drop -t or -d, or choose ones that belong together"
            )
    return [_gallery(table, name, data_root, quick) for table, name in chosen]


def _source(table: Table, data_root: Path | None) -> str:
    return table.dataset if is_present(table.dataset, data_root) or not table.stand_in else table.stand_in


def _table_of(name: str, known: dict[str, Table]) -> Table:
    for table in known.values():
        if name in (table.dataset, table.stand_in):
            return table
    if name not in CATALOGUE and not is_path(name):
        raise did_you_mean("data set", name, CATALOGUE)
    own_name = Path(name).resolve().name if name not in CATALOGUE else name
    return Table(own_name, f"Retrieval on {own_name}", name)


def _gallery(table: Table, name: str, data_root: Path | None, quick: bool) -> Gallery:
    dataset = open_dataset(name, data_root)
    check_retrievable(dataset)
    subjects = list(dict.fromkeys(entry.subject for entry in dataset.entries))
    kept = [subject for place, subject in enumerate(subjects) if not table.subjects or place in table.subjects]
    entries = tuple(entry for entry in dataset.entries if entry.subject in kept)
    return Gallery(table, name, dataset, _thin_out(entries) if quick else entries, quick)


def _thin_out(entries: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """Keep evenly spaced poses of each subject, the first one always."""
    by_subject: dict[str, list[Entry]] = {}
    for entry in entries:
        by_subject.setdefault(entry.subject, []).append(entry)
    kept: set[str] = set()
    for members in by_subject.values():
        step = -(-len(members) // QUICK_POSES)
        kept.update(entry.identifier for entry in members[::step])
    return tuple(entry for entry in entries if entry.identifier in kept)
