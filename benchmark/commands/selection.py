"""What a command is asked about: folders of data, and records of a results folder."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.api.contracts import Input
from benchmark.datasets.catalogue import is_known, is_path, split_changes
from benchmark.defaults import DATA_VARIABLE, DEFAULT_SCORER, RESULTS
from benchmark.errors import ConfigurationError, check_known, check_seed
from benchmark.pipeline.data_names import label_data_sets, records_of
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import INPUTS, SYNTHETIC_HUMANS, TABLES, TITLES
from benchmark.registry import are_named
from benchmark.registry.names import base_name
from benchmark.report.columns import PRINTED_SCORES, QUANTITIES
from benchmark.report.formats import records_of_robustness
from benchmark.report.record_facts import chosen_records, fold_of, row_of, tables_of
from benchmark.report.table_view import TableView
from benchmark.report.tables import table_views
from benchmark.text import brief, counted, listed


def as_list(values: Any) -> list[Any]:
    """Return several values as a list, and a single one as a list of it.

    Parameters
    ----------
    values
        Several are what can be iterated over: a list, a tuple, a generator, an array, ... A set has
        no order that two processes share, so its values are sorted by their texts. Texts, paths,
        and what can be called, such as a method, are single values.
    """
    is_single = isinstance(values, str | bytes | Path) or callable(values)
    if is_single or not isinstance(values, Iterable):
        return [values]
    if isinstance(values, AbstractSet):
        return sorted(values, key=str)
    return list(values)


def as_sets(names: Iterable[str | Path]) -> list[str]:
    """Return names and folders of data sets as records name them: 'people' is its first draw."""
    first_draw = SYNTHETIC_HUMANS[0]
    short = base_name(first_draw)
    sets = []
    for name in map(str, names):
        base, _ = split_changes(name)
        sets.append(first_draw + name.removeprefix(short) if base == short else name)
    return sets


def as_texts(names: str | Path | Iterable[str | Path]) -> list[str]:
    """Return names, or a single one, as a list of texts."""
    return [str(name) for name in as_list(names)]


def as_paths(paths: str | Path | Iterable[str | Path]) -> list[Path]:
    """Return paths, or a single one, as a list."""
    return [Path(path) for path in as_list(paths)]


def check_input(given: Input | None) -> None:
    """Raise ``ConfigurationError`` unless an input is ``"mesh"``, ``"view"`` or None for both."""
    if given is not None:
        check_known("input", [given], INPUTS)


def data_folder(given: str | Path | None = None) -> Path | None:
    """Return the folder of the official data sets, by default that of ``CANONICAL_FORMS_DATA``.

    A folder without sets is valid: stand-ins take their places.

    Raises
    ------
    ConfigurationError
        If it is no folder.
    """
    named = given or os.environ.get(DATA_VARIABLE)
    if not named:
        return None
    if not Path(named).is_dir():
        problem = f"data root {named} is not a readable folder"
        raise ConfigurationError(problem, f"correct --data-root or {DATA_VARIABLE}")
    return Path(named)


def further_options(
    results: Path,
    scorer: str,
    seed: int,
    data_root: str | Path | None,
    plugins: Iterable[Path] = (),
) -> list[str]:
    """Return the options of a command that do not have their defaults, for a command to copy."""
    words: list[str] = []
    if scorer != DEFAULT_SCORER:
        words += ["--scorer", scorer]
    for plugin in plugins:
        words += ["--plugin", str(plugin)]
    if results != RESULTS:
        words += ["--results", str(results)]
    if data_root is not None and str(data_root) != os.environ.get(DATA_VARIABLE):
        words += ["--data-root", str(data_root)]
    if seed != 0:
        words += ["--seed", str(seed)]
    return words


def shadowed_folders(names: Iterable[str], data_root: Path | None) -> list[str]:
    """Say which names mean a data set of the suite, though there is a folder of the same name here.

    Parameters
    ----------
    names
        Names of data sets, as users write them.
    data_root
        Folder of the official data sets. A name of one of its sub-folders is not reported.
    """
    notes = []
    for name in names:
        base, _ = split_changes(name)
        if not (is_known(name) and is_path(name)):
            continue
        if data_root and Path(base).absolute() == (data_root / base).absolute():
            continue
        notes.append(
            f"{base} means the data set of the suite, not the folder of this name here; "
            f"for the folder, pass ./{base}"
        )
    return notes


def outcome(record: Record) -> str:
    """Return the scores of a record and the time a shape took on one line; without scores, why."""
    if record.status != "ok":
        return brief(record.reason)
    scores = " ".join(f"{column.title} {column.cell(record)}" for column in PRINTED_SCORES)
    details = ", ".join(
        f"{quantity.cell(record)} {quantity.title}" for quantity in QUANTITIES if quantity.title
    )
    if record.unsupported:
        details += f"; {brief(record.refusals)}"
    return f"{scores}  ({details})"


def is_of_methods(record: Record, methods: Iterable[str]) -> bool:
    """Return whether methods are named, with or without parameters, of which one made a record."""
    return not {record.method, base_name(record.method)}.isdisjoint(methods)


class SelectedRecords(NamedTuple):
    """Selected records, and notes on those that are left out."""

    records: list[Record]
    notes: list[str]


@dataclass(frozen=True, kw_only=True)
class RecordSelection:
    """The records that tables, pages, figures and comparisons show.

    Parameters
    ----------
    results
        The results folder.
    tables, methods, data
        Identifiers of tables, names of methods, and names or folders of data sets; empty for all.
    input
        ``"mesh"`` or ``"view"``; both by default.
    scorer, seed
        Scorer and base seed.
    quick
        Whether to show quick runs; by default they are shown where there are no others.
    published
        Whether to show published records alone.
    submitted
        Records of others, which are shown beside them; see :mod:`benchmark.commands.submissions`.
    """

    results: Path = RESULTS
    tables: Sequence[str] = ()
    methods: Sequence[str] = ()
    data: Sequence[str] = ()
    input: Input | None = None
    scorer: str = DEFAULT_SCORER
    seed: int = 0
    quick: bool = False
    published: bool = False
    submitted: Sequence[Record] = ()

    def __post_init__(self) -> None:
        """Check what no record has, before records are read."""
        check_input(self.input)
        check_seed(self.seed)

    @property
    def is_whole(self) -> bool:
        """Whether nothing is left out of the tables."""
        return not (self.tables or self.methods or self.data or self.input or self.quick)

    def records(self, *, failed: bool = False) -> SelectedRecords:
        """Return the selected records, and sentences on those that are left out.

        Parameters
        ----------
        failed
            Whether to keep methods that have no scores on any data. By default, they are kept only
            if they were selected by name, or are rows of the paper.

        Raises
        ------
        ConfigurationError
            If there is no such record, or none knows a table or data set that was named.
        """
        stored = read_records(self.results, local=not self.published)
        all_records = label_data_sets([*stored, *self.submitted])
        names = {table.identifier for table in TABLES}
        for record in all_records:  # some data sets have tables of their own
            shown = tables_of(record.data.name, fold_of(record))
            names.update(table.identifier for table in shown)
        check_known("table", self.tables, names | {"extended"})

        of_data = records_of(all_records, as_sets(self.data)) if self.data else all_records
        of_input = [record for record in of_data if self.input in (None, record.input)]
        # Quick runs, which leave out most poses, are shown if asked for, or if there are no others.
        full = chosen_records(of_input, scorer=self.scorer, seed=self.seed)
        quick = chosen_records(of_input, quick=True, scorer=self.scorer, seed=self.seed)
        records = quick
        if full and not self.quick:
            records = full

        notes = [
            *self._of_other_scorers(of_input),
            *self._of_quick_runs(full, quick),
            *self._of_missing_methods(records),
            *self._of_missing_data(records),
        ]
        if not records:
            raise self._no_records(notes)
        if failed:
            return SelectedRecords(records, notes)
        return self._without_failing(records, notes, all_records)

    def _without_failing(
        self, records: list[Record], notes: list[str], every: Iterable[Record]
    ) -> SelectedRecords:
        """Leave out methods that fail in every job, and say so in the notes.

        Methods that were selected by name, and rows of the paper, stay. If nothing else is left,
        all records stay.

        Parameters
        ----------
        records
            Records of the selection.
        notes
            Sentences on records that were left out before.
        every
            All records, which say whether a method has scores anywhere.
        """
        scored = {row_of(record) for record in every if record.status == "ok"}
        shown = []
        hidden = {}  # reason by method
        for record in records:
            row = row_of(record)
            if row in scored or row in TITLES or is_of_methods(record, self.methods):
                shown.append(record)
            else:
                hidden[record.method] = outcome(record)
        if not shown:
            return SelectedRecords(records, notes)
        notes = list(notes)
        for method, reason in hidden.items():
            notes.append(
                f"left out, as it fails in every job: {method}: {reason}; --failed shows it"
            )
        return SelectedRecords(shown, notes)

    def _of_missing_methods(self, records: Sequence[Record]) -> list[str]:
        """Say which methods are named that have no job in the selection."""
        if not are_named(self.methods):
            return []
        names_of_records = set()
        for record in records:
            names_of_records |= {record.method, base_name(record.method)}
        missing = [method for method in self.methods if method not in names_of_records]
        if not missing:
            return []
        return [f"no finished job of {listed(missing)}: run it, or see 'list methods' for its name"]

    def _of_missing_data(self, records: Sequence[Record]) -> list[str]:
        """Say which data sets have no job in the selection, where other named ones have some."""
        if not records:
            return []
        missing = [name for name in self.data if not records_of(records, as_sets([name]))]
        if not missing:
            return []
        return [f"no finished job on {listed(missing)} fits the selection"]

    def _no_records(self, notes: Sequence[str]) -> ConfigurationError:
        """Return an error that says that there is no record, and how to get some."""
        what = "published record" if self.published else "finished job"
        first = "omit --published or --results" if self.published else "run it first"
        problem = f"no {what} under {self.results} fits the selection"
        return ConfigurationError(problem, "; ".join([f"{first}, or select less", *notes]))

    def views(self, records: Sequence[Record], *, paper: bool = False) -> list[TableView]:
        """Return the tables that records fill.

        With ``paper``, they also have rows of the paper that never ran.

        Raises
        ------
        ConfigurationError
            If there is none.
        """
        rows = self.methods if are_named(self.methods) else ()
        sets = {record.data.name for record in records} if self.data else ()
        views = table_views(records, self.tables, rows, sets, paper=paper)
        # The table of robustness is none of the views.
        if views or self.of_robustness(records):
            return views
        what = f"table {', '.join(self.tables)}" if self.tables else "any table"
        job = f"job of {listed(rows)}" if rows else "job"
        problem = f"no finished {job} under {self.results} belongs to {what}"
        raise ConfigurationError(problem, "run it first, or select less")

    def of_robustness(self, records: Sequence[Record]) -> list[Record]:
        """Return the records of the table of robustness; none if it is not selected."""
        if not (self.is_whole or "robustness" in self.tables):
            return []
        methods = self.methods if are_named(self.methods) else ()
        return records_of_robustness(records, methods)

    def empty_tables(self, records: Sequence[Record], views: Sequence[TableView]) -> list[str]:
        """Say which tables were named of which nothing is shown.

        Parameters
        ----------
        records, views
            From :meth:`records` and :meth:`printed_views`.
        """
        shown = {view.table.identifier for view in views}
        shown |= {view.table.part_of for view in views}  # extended
        if self.of_robustness(records):
            shown.add("robustness")
        empty = [name for name in self.tables if name not in shown]
        if not empty:
            return []
        return [f"not shown: table {listed(empty)}, of which no finished job fits the selection"]

    def printed_views(
        self, records: Sequence[Record], notes: Sequence[str], *, paper: bool = False
    ) -> list[TableView]:
        """Return the tables that have a row of a selected method.

        Parameters
        ----------
        records, notes
            From :meth:`records`.
        paper
            Whether to add rows of the paper that never ran.

        Raises
        ------
        ConfigurationError
            If there is none.
        """
        views = self.views(records, paper=paper)
        printed = [view for view in views if view.printed_rows]
        if views and not printed:
            problem = f"no table has a row of {listed(self.methods)}"
            raise ConfigurationError(problem, "; ".join([*notes, "select other methods with -m"]))
        return printed

    def _of_other_scorers(self, records: Iterable[Record]) -> list[str]:
        """Say how many jobs of other scorers or seeds there are, and which options show them."""
        others = [
            record
            for record in records  # descriptors have no scorer
            if record.scorer not in (self.scorer, "") or record.seed != self.seed
        ]
        if not others:
            return []
        options = {
            f"--scorer {record.scorer or self.scorer} --seed {record.seed}" for record in others
        }
        jobs = counted(len(others), "job")
        choices = ", or ".join(sorted(options))
        return [f"not shown: {jobs} of another scorer or seed: pass {choices}"]

    def _of_quick_runs(self, full: Sequence[Record], quick: Sequence[Record]) -> list[str]:
        """Say which quick runs are newer than all others, or that there are no others."""
        newest = max((record.finished for record in full if not record.published), default="")
        newer = [record for record in quick if record.finished > newest]
        if self.quick or not newer:
            return []
        sets = ", ".join(dict.fromkeys(record.data.name for record in newer))
        if full:
            return [f"{len(newer)} newer quick jobs are not shown: pass --quick ({sets})"]
        return [f"these are quick runs ({sets})"]
