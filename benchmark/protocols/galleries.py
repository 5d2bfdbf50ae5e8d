"""Galleries: the shapes that a table ranks against each other, and the methods tested on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Part, check_retrievable, thinned
from benchmark.datasets.catalogue import (
    CATALOGUE,
    check_ranked,
    is_known,
    is_path,
    is_present,
    open_dataset,
    table_name,
)
from benchmark.datasets.changes import CHANGES, LEVELS, changed_name, last_change
from benchmark.errors import ConfigurationError, DatasetError, did_you_mean
from benchmark.plugins.registry import MethodSpec
from benchmark.protocols.models import has_models
from benchmark.protocols.tables import AVERAGED, TABLES, Rows, Table

#: Most poses of each subject with ``--quick``, which keeps every k-th pose.
QUICK_POSES = 3


def gallery_name(dataset: str, part: str, *, quick: bool) -> str:
    """Return the name of a gallery in plans and records: data set, part, and whether poses were omitted."""
    return f"{dataset}{part and ' ' + part}{' (quick)' if quick else ''}"


@dataclass(frozen=True)
class Gallery:
    """The shapes that one table ranks against each other.

    Parameters
    ----------
    table
        The table.
    source
        Name or path of the data set, for other processes.
    dataset
        The data set in use: the paper's or its stand-in.
    entries
        The shapes, in matrix order.
    quick
        Whether poses were omitted to save time.
    part
        Part of the data set in words, such as ``"fold 0"``; "" for the whole data set.
    data_root
        The folder of the official data sets.
    few_rows
        Whether methods that are not in the paper were omitted to save time.
    """

    table: Table
    source: str
    dataset: ShapeSet
    entries: tuple[Entry, ...]
    quick: bool = False
    part: str = ""
    data_root: Path | None = None
    few_rows: bool = False

    @property
    def name(self) -> str:
        """Name of the gallery in plans and records."""
        return gallery_name(self.dataset.name, self.part, quick=self.quick)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs under which it is ranked: those of its table that its shapes support."""
        offered = self.dataset.inputs
        if self.table.robustness and (change := last_change(self.dataset.name)):
            offered = tuple(input_ for input_ in offered if input_ in CHANGES[change[1]].inputs)
        return tuple(input_ for input_ in self.table.inputs if input_ in offered)

    def check_input(self, input_: str) -> None:
        """Raise ``ConfigurationError`` for a requested input that its shapes do not have."""
        if input_ in self.dataset.inputs:
            return
        what = "holds depth images, which show" if self.dataset.observe else "is seen by a changed camera, which shows"
        raise ConfigurationError(
            f"data set '{self.dataset.name}' {what} one side of each shape",
            "drop --input mesh: there are no complete surfaces",
        )

    def rows(self, methods: Iterable[MethodSpec], trained_here: Path | None = None) -> list[MethodSpec]:
        """Return the methods that are tested on it, some in several variants.

        If a row is a mean over trainings, each training with a model is a variant.

        Parameters
        ----------
        methods
            The selected methods.
        trained_here
            Folder of the models that were trained here, in addition to the shipped ones.
        """
        rows = self.table.rows.quick() if self.few_rows else self.table.rows
        variants = [variant for spec in methods for variant in self._variants(spec, rows, trained_here)]
        with_trainings = [row for variant in variants for row in self._averaged(variant, rows, trained_here)]
        return list({row.name: row for row in with_trainings}.values())

    def _variants(self, spec: MethodSpec, rows: Rows, trained_here: Path | None) -> Iterator[MethodSpec]:
        """Return a method if it has a row, and its additional rows if it was not selected by name."""
        included = spec.named or rows.include(spec)
        if self.table.ablation:
            included = included and spec.learns and spec.split != "sampled"
        if included:
            yield spec
        if spec.named or spec.parameters:
            return
        trainings = rows.trainings.get(self.dataset.name, {}).get(spec.base_name, ())
        for parameters in (*rows.models.get(spec.base_name, ()), *({"training": name} for name in trainings)):
            variant = spec.with_parameters(dict(parameters))
            if has_models(variant, self, trained_here):
                yield variant

    def _averaged(self, spec: MethodSpec, rows: Rows, trained_here: Path | None) -> Iterator[MethodSpec]:
        """Return the method, and its variants with other trainings that share its row and have models."""
        yield spec
        name = rows.averaged
        if not name or name in spec.parameters or not spec.learns or spec.split != "table":
            return
        parameters = spec.all_parameters
        if name in parameters:
            values = (value for value in AVERAGED[name] if value != parameters[name])
            further = (spec.with_parameters({name: value}) for value in values)
            yield from (variant for variant in further if has_models(variant, self, trained_here))


def galleries(
    table_names: Iterable[str] = (),
    dataset_names: Iterable[str] = (),
    data_root: Path | None = None,
    quick: bool = False,
) -> list[Gallery]:
    """Return the galleries for a selection on the command line.

    The paper's data set is used if it is available and its stand-in otherwise, never both in one table. A table that
    accompanies another one is omitted if the data set lacks its classes, unless it was selected by name.

    Parameters
    ----------
    table_names
        Numerals of tables; empty for all.
    dataset_names
        Names of data sets or paths of folders; empty for those of the tables. A data set that no table uses gets its
        own table.
    data_root
        The folder of the official data sets.
    quick
        Use at most :data:`QUICK_POSES` poses of each subject, only the first fold and, unless methods are selected by
        name, only the methods of the paper and :data:`QUICK_CONTROLS`.

    Raises
    ------
    ConfigurationError
        If a name is unknown, the selection is empty, or an ablation is combined with ``quick``.
    DatasetError
        If a data set is missing or unreadable, or its part in a table is unfit for retrieval.
    """
    known = {table.identifier: table for table in TABLES}
    wanted_tables, wanted_sets = list(table_names), list(dataset_names)
    for name in wanted_tables:
        if name not in known:
            raise did_you_mean("table", name, known)
        if quick and known[name].ablation:
            raise ConfigurationError(f"table {name} is a mean over all folds, and --quick has one", "drop --quick")
    selected = [table for table in TABLES if _is_selected(table, wanted_tables, wanted_sets, quick)]
    places = [(table, name) for table in selected for name in _sources(table, data_root, wanted_tables)]
    if wanted_sets:
        places = [(table, name) for name in wanted_sets for table in _tables_of(name, selected, own=not wanted_tables)]
        further = [(table, name) for table in selected if table.robustness for name in wanted_sets]
        places += [(replace(table, dataset=name), name) for table, name in further if name != table.dataset]
        if not places:
            raise ConfigurationError(
                f"no selected table uses {', '.join(wanted_sets)}", "drop -t or -d, or choose ones that belong together"
            )
    chosen: list[Gallery] = []
    for table, name in places:
        try:
            for condition in _conditions(name) if table.robustness else [name]:
                chosen += _galleries(table, condition, data_root, quick)
        except DatasetError:
            if not table.part_of or table.identifier in wanted_tables:
                raise
    return chosen


def _is_selected(table: Table, tables: list[str], sets: list[str], quick: bool) -> bool:
    """Return whether a selection includes a table, by its numeral or its data set."""
    if table.identifier in tables:
        return True
    if table.runs == "named":
        return not table.robustness and not tables and bool(set(table.datasets) & set(sets))
    by_set = bool(sets) and not table.part_of and not table.ablation
    return (not tables or table.part_of in tables) and (not quick or table.runs == "quick" or by_set)


def _sources(table: Table, data_root: Path | None, asked_for: Iterable[str]) -> list[str]:
    """Return the data sets of a table, of several those present; raise ``DatasetError`` if a named table has none."""
    if not table.any_of:
        return [table.dataset if is_present(table.dataset, data_root) or not table.stand_in else table.stand_in]
    present = [name for name in table.any_of if is_present(name, data_root)]
    if not present and table.identifier in asked_for:
        absent = ", ".join(f"{name} ({CATALOGUE[name].folder}/)" for name in table.any_of)
        raise DatasetError(
            f"table {table.identifier} has no data: of its sets none is at {data_root or 'DATA_ROOT'}: {absent}",
            "put one there and pass --data-root; 'data list --json' shows where to get each",
        )
    return present


def _tables_of(name: str, selected: Iterable[Table], *, own: bool) -> list[Table]:
    """Return the tables that use a data set; if there are none, its own table on request."""
    if not is_known(name) and not is_path(name):
        raise did_you_mean("data set", name, CATALOGUE)
    if any(name in table.datasets for table in TABLES if not table.robustness) or not own:
        return [table for table in selected if name in table.datasets]
    own_name = table_name(name)
    if any(own_name == table.identifier for table in TABLES):
        own_name += "-folder"
    return [Table(own_name, f"Retrieval on {own_name}", name, all_unseen=False)]


def _galleries(table: Table, name: str, data_root: Path | None, quick: bool) -> list[Gallery]:
    dataset = open_dataset(name, data_root)
    check_ranked(dataset)
    check_retrievable(dataset)

    def gallery(subjects: tuple[int | str, ...], part: str) -> Gallery:
        entries = Part(subjects).of(dataset)
        check_retrievable(dataset, entries if part else None)
        some = thinned(entries, QUICK_POSES) if quick else entries
        return Gallery(table, name, dataset, some, len(some) < len(entries), part, data_root, few_rows=quick)

    parts = zip(table.folds or (table.subjects,), table.parts, strict=True)
    return [gallery(subjects, part) for subjects, part in parts][: 1 if quick else None]


def _conditions(name: str) -> list[str]:
    """Return a clean data set, and the same under each perturbation at each strength, by name or path."""
    shown = [change for change in CHANGES if change not in ("jitter", "perspective")]
    return [name, *(changed_name(name, change, level) for change in shown for level in LEVELS)]
