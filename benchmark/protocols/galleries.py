"""Galleries: the shapes that a table ranks against each other, and the methods tested on them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.api.datasets import Entry, ShapeSet
from benchmark.api.learning import HasRecipe, Learner
from benchmark.datasets.base import Part, check_retrievable, thinned
from benchmark.datasets.catalogue import (
    check_ranked,
    is_present,
    open_dataset,
    require_known,
    table_name,
)
from benchmark.datasets.changes import CHANGES, STRENGTHS, changed_name, split_changes
from benchmark.errors import ConfigurationError, DatasetError, check_known
from benchmark.protocols.models import (
    MissingModel,
    Model,
    TooNear,
    UnusableModel,
    find_models,
    has_model,
)
from benchmark.protocols.tables import (
    AGAINST,
    CAMERAS,
    INPUTS,
    PARTS,
    TABLES,
    Table,
    gallery_name,
    own_table,
)
from benchmark.protocols.trainings import NoFolds, Training, trainings_by_shape
from benchmark.reference.paper import CLASSICAL
from benchmark.registry import Component

#: Most poses of each subject with ``--quick``, which keeps every k-th pose.
QUICK_POSES = 3

#: The network of the paper, whose row says so where it has no model.
NETWORK = "learned"

#: Seeds of trainings besides 0, over which rows are averaged.
SEEDS = (1, 2)

#: Methods with rows in quick runs: those of the paper, and the shape itself.
QUICK_ROWS = (*CLASSICAL, NETWORK, "identity")


@dataclass(frozen=True)
class Gallery:
    """The shapes that one table ranks against each other, with the methods that are tested on them.

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
        Whether poses were omitted to save time; if so, only methods of the paper have rows.
    part
        Part of the data set in words, such as ``"fold 0"``; "" for the whole data set.
    data_root
        The folder of the official data sets.
    inputs
        The inputs of its column that its shapes have.
    is_split
        Whether networks see only views, and all other methods only complete surfaces.
    gallery_of_queries
        The gallery if its shapes are queries of another one, with the input of that one.
    cameras
        Change of the data set that shows each shape from several cameras; "" for none.
    """

    table: Table
    source: str
    dataset: ShapeSet
    entries: tuple[Entry, ...]
    quick: bool = False
    part: str = ""
    data_root: Path | None = None
    inputs: tuple[Input, ...] = ()
    is_split: bool = False
    gallery_of_queries: Gallery | None = None
    cameras: str = ""

    @cached_property
    def seen(self) -> Gallery:
        """Return the gallery with a shape for each view of a shape; itself without cameras."""
        if not self.cameras:
            return self
        source, wanted = (
            f"{self.source}{self.cameras}",
            {entry.identifier for entry in self.entries},
        )
        dataset = open_dataset(source, self.data_root)
        entries = tuple(
            entry for entry in dataset.shapes if entry.identifier.rpartition("@")[0] in wanted
        )
        return replace(self, source=source, dataset=dataset, entries=entries, cameras="")

    @property
    def n_views(self) -> int:
        """Number of views of each shape."""
        return len(self.seen.entries) // len(self.entries)

    @property
    def name(self) -> str:
        """Name of the gallery in plans and records."""
        return gallery_name(self.dataset.name, self.part, quick=self.quick)

    def of_subjects(self, subjects: Sequence[str]) -> Gallery:
        """Return the gallery of some subjects; raise ``ConfigurationError`` if there is no such subject."""
        check_known("subject", subjects, {entry.subject for entry in self.entries})
        entries = tuple(entry for entry in self.entries if entry.subject in subjects)
        if self.gallery_of_queries is None:
            check_retrievable(self.dataset, entries)
        return replace(self, entries=entries, part=f"{', '.join(subjects)} {self.part}".strip())

    def rows(
        self,
        input_: Input,
        methods: Iterable[Component],
        trained_here: Path | None = None,
        *,
        named: bool = False,
    ) -> list[Component]:
        """Return the methods that are tested on it; networks with each of their trainings that has a model.

        Parameters
        ----------
        input_
            The input.
        methods
            The selected methods.
        trained_here
            Folder of the models that were trained here, in addition to the shipped ones.
        named
            Whether they were selected by name: they have a row in every table, like those of
            plugins.
        """
        chosen: list[Component] = []
        for method in methods:
            is_wanted = named or not method.of_suite
            try:
                if self._includes(input_, method, is_wanted):
                    chosen += self._trainings(method, trained_here, is_wanted)
            except ConfigurationError:  # it cannot be imported, and its row says why
                chosen.append(method)
        return list({method.name: method for method in chosen}.values())

    def _includes(self, input_: Input, method: Component, is_wanted: bool) -> bool:
        is_network = method.learns and "view" in method.info.inputs
        if self.is_split and is_network != (input_ == "view") and method.info.family != "external":
            return False
        if is_wanted:
            return method.learns or not self.table.is_ablation
        name = method.base_name
        is_default = self.table.includes(name) and name not in self.table.omits
        if self.table.changes and not self.table.names and split_changes(self.source)[1]:
            is_default &= name in QUICK_ROWS or method.learns
        return is_default and (not self.quick or name in QUICK_ROWS)

    def _trainings(
        self, method: Component, trained_here: Path | None, is_wanted: bool
    ) -> Iterator[Component]:
        """Yield a method; a network also with other seeds, and that of the paper as printed, where it has models."""
        is_papers = method.base_name == NETWORK
        if not method.learns or is_papers or is_wanted or self._has_models(method, trained_here):
            yield method
        if not method.learns or method.parameters or self.quick or method.given is not None:
            return
        seeds = SEEDS if hasattr(method.load(), "training_seed") else ()
        variants: list[dict[str, object]] = [{"training_seed": seed} for seed in seeds]
        variants += (
            [{"configuration": "as_printed"}] if is_papers and not self.table.is_ablation else []
        )
        others = map(method.with_parameters, variants)
        yield from (other for other in others if self._has_models(other, trained_here))

    def _has_models(self, method: Component, trained_here: Path | None) -> bool:
        """Return whether a learner has a model for each shape, be it one that is refused."""
        try:
            return bool(self.models(method, trained_here))
        except TooNear:
            return True
        except (MissingModel, NoFolds) as error:
            return isinstance(error, UnusableModel)

    def lacking(
        self,
        input_: Input,
        methods: Iterable[Component],
        trained_here: Path | None = None,
        *,
        named: bool = False,
    ) -> Iterator[tuple[Component, Training]]:
        """Yield the trainings without a model that rows of networks would need, as far as this code can train them.

        Parameters
        ----------
        input_, methods, trained_here, named
            As in :meth:`rows`.
        """
        for method in methods:
            with contextlib.suppress(ConfigurationError):  # its row says what is wrong
                if not method.learns or method.missing_packages():
                    continue
                if self._includes(input_, method, named or not method.of_suite):
                    yield from self._lacking_of(method, trained_here)

    def _lacking_of(
        self, method: Component, trained_here: Path | None
    ) -> Iterator[tuple[Component, Training]]:
        """Yield the trainings that a network and its variants in tables lack."""
        is_fixed = bool(method.parameters) or self.quick or method.given is not None
        variants = [method]
        if not is_fixed and method.base_name == NETWORK and not self.table.is_ablation:
            variants.append(method.with_parameters({"configuration": "as_printed"}))
        for variant in variants:
            learner = variant.create()
            if not isinstance(learner, Learner):
                continue
            of_shapes = trainings_by_shape(learner, self.dataset, self.entries, self.data_root)
            for training in dict.fromkeys(of_shapes.values()):
                if training.is_frozen or not training.dataset:
                    continue
                seeds: Sequence[int] = ()
                if not is_fixed and isinstance(learner, HasRecipe):
                    seeds = learner.seeds(training.name)
                seeded = [
                    variant.with_parameters({"training_seed": seed}) for seed in seeds if seed
                ]
                for component in (variant, *seeded):
                    if not has_model(component.create(), training.name, trained_here):
                        yield component, training

    def models(self, method: Component, trained_here: Path | None) -> dict[str, Model]:
        """Return the model for each shape; see :func:`benchmark.protocols.models.find_models`."""
        return find_models(method, self.dataset, self.entries, self.data_root, trained_here)


def galleries(
    tables: Iterable[str] = (),
    datasets: Iterable[str] = (),
    data_root: Path | None = None,
    *,
    quick: bool = False,
    subjects: Sequence[str] = (),
    input: Input | None = None,
    gallery: str = "",
    gallery_views: int = 0,
    same_names: bool = False,
) -> list[Gallery]:
    """Return the galleries of a selection.

    The paper's data set is used if it is available and its stand-in otherwise, never both in one
    table. A table that accompanies another one is omitted if the data set lacks its classes, unless
    it was selected by name.

    Parameters
    ----------
    tables
        Identifiers of tables; empty for all.
    datasets
        Names of data sets or paths of folders; empty for those of the tables. A data set that no
        table uses gets its own table.
    data_root
        The folder of the official data sets.
    quick
        Use at most :data:`QUICK_POSES` poses of each subject, and only the first fold.
    subjects, input
        Subjects, or the input, that are meant; all of them by default.
    gallery, gallery_views, same_names
        Data set of the gallery whose queries the data sets are, which lacks shapes with the name of
        the query for ``same_names``. With ``gallery_views``, it is rendered from so many cameras
        around each shape; by default it is the data set.

    Raises
    ------
    ConfigurationError
        If a name is unknown, the selection is empty, or an ablation is combined with ``quick``.
    DatasetError
        If a data set is missing or unreadable, or its part in a table is unfit for retrieval.
    """
    sets, chosen = [*datasets], list[Gallery]()
    if gallery or same_names or gallery_views:
        if not ((gallery or gallery_views) and sets) or [*tables]:
            raise ConfigurationError(
                "--gallery needs queries, and no table", "pass -d QUERIES --gallery FOLDER"
            )
        seen = f"{gallery_views} cameras{' around ' * bool(gallery)}" if gallery_views else ""
        for name in sets:
            words = f"{seen}{gallery and table_name(gallery)}{' without same names' * same_names}"
            own, is_other = (
                own_table(table_name(name), f"{AGAINST}{words}"),
                bool(gallery) and not same_names,
            )
            table = replace(own, gallery=gallery, keeps_same_names=is_other)
            if gallery_views:
                table = replace(
                    table, columns=table.columns[1:], cameras=f"[cameras={gallery_views}]"
                )
            chosen += _galleries(table, name, data_root, quick=quick)
    else:
        chosen = _of_tables([*tables], sets, data_root, quick=quick)
    if subjects:  # some tables show a part of a data set: those that have the subjects are meant
        having = [
            gallery
            for gallery in chosen
            if {entry.subject for entry in gallery.entries}.issuperset(subjects)
        ]
        chosen = [gallery.of_subjects(subjects) for gallery in having or chosen]
    if input is None:
        return chosen
    fitting = [replace(gallery, inputs=(input,)) for gallery in chosen if input in gallery.inputs]
    if not fitting and input not in (dataset := chosen[0].dataset).inputs:
        problem = f"data set '{dataset.name}' has no complete surfaces, only views of one side of each shape"
        raise ConfigurationError(problem, f"drop --input {input}")
    return fitting


def _of_tables(
    wanted: Sequence[str], sets: Sequence[str], data_root: Path | None, *, quick: bool
) -> list[Gallery]:
    """Return the galleries of tables, by their names or by those of data sets."""
    check_known("table", wanted, [table.identifier for table in TABLES] + ["extended"])
    for name in wanted:
        if quick and any(table.identifier == name and table.is_ablation for table in TABLES):
            raise ConfigurationError(
                f"table {name} is a mean over all folds, and --quick has one", "drop --quick"
            )
    selected = [table for table in TABLES if _is_selected(table, wanted, sets, quick)]
    if sets:
        places = [
            (table, name) for name in sets for table in _tables_of(name, selected, own=not wanted)
        ]
    else:
        places = [
            (table, name) for table in selected if (name := _source(table, data_root, wanted))
        ]
    if not places:
        problem = (
            f"no selected table uses {', '.join(sets)}"
            if sets
            else "the selected tables have no data"
        )
        raise ConfigurationError(problem, "drop -t or -d, or choose ones that belong together")
    chosen: list[Gallery] = []
    for table, name in places:
        try:
            chosen += list(_galleries(table, name, data_root, quick=quick))
        except DatasetError:
            if not table.part_of or table.identifier in wanted:
                raise
    return chosen


def _is_selected(table: Table, tables: Sequence[str], sets: Sequence[str], quick: bool) -> bool:
    """Return whether a selection includes a table, by its name, that of the table it belongs to, or its data set."""
    if tables:
        return table.identifier in tables or (table.part_of in tables and not quick)
    if table.runs in ("named", "alone"):
        return table.runs == "named" and bool(set(table.datasets) & set(sets))
    return (
        table.runs == "quick"
        or not quick
        or (bool(sets) and not table.part_of and not table.is_ablation)
    )


def _source(table: Table, data_root: Path | None, asked_for: Sequence[str]) -> str:
    """Return the data set of a table; "" for one that is absent, where the table was not asked for by its name."""
    if is_present(table.dataset, data_root) or (
        not table.stand_ins and table.identifier in asked_for
    ):
        return table.dataset
    return table.stand_ins[0] if table.stand_ins else ""


def _tables_of(name: str, selected: Iterable[Table], *, own: bool) -> list[Table]:
    """Return the tables that use a data set; if there are none, its own table on request."""
    require_known(name)
    if own and not any(name in table.datasets for table in TABLES if not table.is_robustness):
        return [own_table(table_name(name))]
    return [table for table in selected if table.shows(name) or table.is_robustness]


def _galleries(
    table: Table, name: str, data_root: Path | None, *, quick: bool
) -> Iterator[Gallery]:
    """Yield the galleries of a table on a data set; with ``quick``, of the columns with folds if there are any."""
    with_folds = tuple(column for column in table.columns if len(column.parts) > 1) if quick else ()
    for column in with_folds or table.columns:
        is_split = column.input == "as printed"
        sets = table.stand_ins if column.over_draws and name in table.stand_ins[:1] else (name,)
        sets += tuple(f"{name}{change}" for change in table.changes if name in table.datasets)
        for source in _conditions(name) if table.is_robustness else sets:
            dataset = open_dataset(source, data_root)
            check_ranked(dataset)
            wanted = (INPUTS if source == sets[0] else INPUTS[:1]) if is_split else (column.input,)
            inputs = tuple(input_ for input_ in dataset.inputs if input_ in wanted)
            for part in column.parts[: 1 if quick else None]:
                entries = Part(PARTS.get(part, ())).of(dataset)
                against = (
                    _known(table, source, part, data_root, quick=quick)
                    if part.startswith(AGAINST)
                    else None
                )
                if against is None:
                    check_retrievable(dataset, entries if part else None)
                some = thinned(entries, QUICK_POSES) if quick else entries
                is_quick = len(some) < len(entries)
                yield Gallery(
                    table,
                    source,
                    dataset,
                    some,
                    is_quick,
                    part,
                    data_root,
                    inputs,
                    is_split,
                    against,
                )


def _known(table: Table, source: str, part: str, data_root: Path | None, *, quick: bool) -> Gallery:
    """Return the gallery of queries: complete surfaces where there are any, of their own data set by default."""
    name = table.gallery or source
    while (
        "mesh" not in (dataset := open_dataset(name, data_root)).inputs and split_changes(name)[1]
    ):
        name = name.rpartition("[")[0]  # what changes views alone
    entries = thinned(dataset.shapes, QUICK_POSES) if quick else dataset.shapes
    cameras = CAMERAS.get(part, table.cameras)
    inputs = ("view",) if cameras else dataset.inputs[:1]
    return Gallery(
        table, name, dataset, entries, quick, data_root=data_root, inputs=inputs, cameras=cameras
    )


def _conditions(name: str) -> list[str]:
    """Return a data set, and the same under each change of its meshes at three strengths, by name or path."""
    shown = [change for change, what in CHANGES.items() if what.of_mesh and change != "jitter"]
    return [
        name,
        *(changed_name(name, change, level) for change in shown for level in list(STRENGTHS)[::2]),
    ]
