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
    can_be_trained,
    find_models,
    has_model,
)
from benchmark.protocols.tables import (
    AGAINST,
    CAMERAS,
    PARTS,
    QUICK_POSES,
    TABLES,
    GalleryGroup,
    Table,
    are_queries_of_another,
    gallery_name,
    own_table,
)
from benchmark.protocols.trainings import NoFolds, Training, trainings_by_shape
from benchmark.reference.paper import CLASSICAL
from benchmark.registry import Component

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
        Whether it is of a quick run, which takes few poses and methods.
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
        source = f"{self.source}{self.cameras}"
        dataset = open_dataset(source, self.data_root)
        wanted = {entry.identifier for entry in self.entries}
        entries = tuple(entry for entry in dataset.shapes if _shape_of(entry) in wanted)
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
        """Return the gallery of some subjects.

        Raise ``ConfigurationError`` if there is no such subject.
        """
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
        """Return the methods that are tested on it.

        Networks with each of their trainings that has a model.

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
            except ConfigurationError:  # it lacks a package, and its row says which
                chosen.append(method)
        return list({method.name: method for method in chosen}.values())

    def _includes(self, input_: Input, method: Component, is_wanted: bool) -> bool:
        """Return whether a method has a row in the table of this gallery for an input.

        Parameters
        ----------
        input_
            ``"mesh"`` or ``"view"``.
        method
            The method.
        is_wanted
            Whether the user named it, or it is a plugin. It then has a row in every table, except
            that a table of networks has rows of networks alone.
        """
        if self.is_split and not _is_seen_in_mixed_column(method, input_):
            return False
        if is_wanted:
            return method.learns or not self.table.is_ablation
        name = method.base_name
        if not self.table.includes(name):
            return False
        if self.table.omits_extended and not method.learns and method.info.family == "extended":
            return False
        is_quick_row = name in QUICK_ROWS
        # On damaged data, and in quick runs, a few methods stand for all.
        if self._is_change_of_table() and not (is_quick_row or method.learns):
            return False
        return is_quick_row or not self.quick

    def _is_change_of_table(self) -> bool:
        """Return whether its data are changed ones of a table that has few methods on these."""
        _, changes = split_changes(self.source)
        return bool(self.table.changes and not self.table.names and changes)

    def _trainings(
        self, method: Component, trained_here: Path | None, is_wanted: bool
    ) -> Iterator[Component]:
        """Yield a method once for each of its trained models that has a row.

        Parameters
        ----------
        method
            The method. One that does not learn is yielded once.
        trained_here
            Folder of models that the user trained, beside those of the suite.
        is_wanted
            Whether the user named it. It is then yielded even without a model: the row says so.
        """
        is_papers = method.base_name == NETWORK
        if not method.learns or is_papers or is_wanted or self._has_models(method, trained_here):
            yield method
        if not method.learns or self._is_fixed(method):
            return

        # Trainings with other seeds, and that of the paper's network as the paper prints it.
        variants: list[dict[str, object]] = []
        if hasattr(method.load(), "training_seed"):
            variants += [{"training_seed": seed} for seed in SEEDS]
        if is_papers and not self.table.is_ablation:
            variants.append({"configuration": "as_printed"})
        for variant in map(method.with_parameters, variants):
            if self._has_models(variant, trained_here):
                yield variant

    def _is_fixed(self, method: Component) -> bool:
        """Return whether a network has a row of its own alone, and none of its other trainings."""
        return method.is_fixed or self.quick

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
        """Yield the trainings without a model that rows of networks would need.

        There are none that cannot be trained here: by this code, on data that are here.

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
        """Yield the missing trainings of a network that this code can do, each with its row.

        A network may have several rows, of other seeds or another configuration, which need models
        of their own.

        Parameters
        ----------
        method
            The network.
        trained_here
            Folder of models that the user trained, beside those of the suite.
        """
        is_fixed = self._is_fixed(method)
        variants = [method]
        if not is_fixed and method.base_name == NETWORK and not self.table.is_ablation:
            variants.append(method.with_parameters({"configuration": "as_printed"}))
        for variant in variants:
            learner = variant.create()
            if not isinstance(learner, Learner):
                continue
            by_shape = trainings_by_shape(learner, self.dataset, self.entries, self.data_root)
            for training in dict.fromkeys(by_shape.values()):
                # A run knows the data of the catalogue alone, of which some may not be here.
                has_data = training.dataset and is_present(training.dataset, self.data_root)
                if not has_data:
                    continue
                rows = [variant] if is_fixed else _with_seeds(variant, learner, training.name)
                for row in rows:
                    network = row.create()
                    if has_model(network, training.name, trained_here):
                        continue
                    if can_be_trained(network, training.name):
                        yield row, training

    def models(self, method: Component, trained_here: Path | None) -> dict[str, Model]:
        """Return the model for each shape; see :func:`benchmark.protocols.models.find_models`."""
        return find_models(method, self.dataset, self.entries, self.data_root, trained_here)


def _with_seeds(network: Component, learner: Learner, training: str) -> list[Component]:
    """Return a network, and the same with each further seed of its recipe for a training."""
    rows = [network]
    if isinstance(learner, HasRecipe):
        further_seeds = [seed for seed in learner.seeds(training) if seed != 0]
        rows += [network.with_parameters({"training_seed": seed}) for seed in further_seeds]
    return rows


def _is_seen_in_mixed_column(method: Component, input_: Input) -> bool:
    """Return whether a method has scores of an input in a column of mixed inputs.

    Networks have scores of depth views, and all others of complete surfaces; forms of other
    programs may be of either.
    """
    if method.info.family == "external":
        return True
    is_network = method.learns and "view" in method.info.inputs
    return is_network == (input_ == "view")


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
    """Return the selected galleries: the shapes on which each column of a table ranks methods.

    Each table uses the paper's data set if that is available, and its generated stand-in otherwise.
    A table that accompanies another one is left out if the data set lacks its classes, unless it
    was selected by name.

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
    subjects
        Subjects that are used; all by default.
    input
        ``"mesh"`` or ``"view"``; both by default.
    gallery
        Data set in which the shapes of ``datasets`` are queries; by default, these rank each other.
    gallery_views
        Number of cameras around each shape from which the gallery is rendered; 0 for none.
    same_names
        Whether a shape of the gallery is left out if it has the name of the query.

    Raises
    ------
    ConfigurationError
        If a name is unknown, nothing is selected of a data set that was named, or an ablation is
        combined with ``quick``.
    DatasetError
        If a data set is missing or unreadable, or its part in a table is unfit for retrieval.
    """
    names = list(datasets)
    identifiers = list(tables)
    has_gallery = bool(gallery or gallery_views)
    has_queries_alone = has_gallery and bool(names) and not identifiers
    if (has_gallery or same_names) and not has_queries_alone:
        raise ConfigurationError(
            "--gallery needs queries, and no table", "pass -d QUERIES --gallery FOLDER"
        )
    if not names:
        return _of_selection(_of_tables(identifiers, [], data_root, quick=quick), subjects, input)

    # Each data set is selected alone: one of which nothing fits is refused, also beside others.
    chosen: list[Gallery] = []
    for name in names:
        if has_gallery:
            table = _table_of_queries(name, gallery, gallery_views, same_names=same_names)
            of_name = list(_galleries(table, name, data_root, quick=quick))
        else:
            of_name = _of_tables(identifiers, [name], data_root, quick=quick)
        chosen += _of_selection(of_name, subjects, input)
    return chosen


def _of_selection(
    of_data: list[Gallery], subjects: Sequence[str], input: Input | None
) -> list[Gallery]:
    """Return the galleries of some subjects and of an input; without these, all of them."""
    if subjects:
        of_data = _of_subjects(of_data, subjects)
    if input is not None:
        of_data = _of_input(of_data, input)
    return of_data


def _table_of_queries(name: str, gallery: str, gallery_views: int, *, same_names: bool) -> Table:
    """Return a table for a data set whose shapes are queries to another gallery.

    Its title names the gallery, such as "12 cameras around tosca".

    Parameters
    ----------
    name
        Name or folder of the data set.
    gallery
        Name or folder of the gallery; "" for the data set itself.
    gallery_views
        Number of cameras around each shape from which the gallery is rendered; 0 for none.
    same_names
        Whether a shape of the gallery is left out if it has the name of the query.
    """
    words = []
    if gallery_views:
        around = " around " if gallery else ""
        words.append(f"{gallery_views} cameras{around}")
    if gallery:
        words.append(table_name(gallery))
    if same_names:
        words.append(" without same names")
    table = own_table(table_name(name), f"{AGAINST}{''.join(words)}")
    keeps_same_names = bool(gallery) and not same_names
    table = replace(table, gallery=gallery, keeps_same_names=keeps_same_names)
    if gallery_views:  # leave out the column of complete surfaces
        columns = table.columns[1:]
        table = replace(table, columns=columns, cameras=f"[cameras={gallery_views}]")
    return table


def _of_subjects(chosen: Sequence[Gallery], subjects: Sequence[str]) -> list[Gallery]:
    """Return the galleries of some subjects.

    Some tables show a part of a data set: those that have the subjects are meant.
    """
    having = []
    for gallery in chosen:
        known = {entry.subject for entry in gallery.entries}
        if known.issuperset(subjects):
            having.append(gallery)
    return [gallery.of_subjects(subjects) for gallery in having or chosen]


def _of_input(chosen: Sequence[Gallery], input_: Input) -> list[Gallery]:
    """Return galleries with one input; raise ``ConfigurationError`` if the data set lacks it."""
    fitting = [replace(gallery, inputs=(input_,)) for gallery in chosen if input_ in gallery.inputs]
    dataset = chosen[0].dataset
    if not fitting and input_ not in dataset.inputs:
        problem = (
            f"data set '{dataset.name}' has no complete surfaces, only views of one side of each "
            "shape"
        )
        raise ConfigurationError(problem, f"drop --input {input_}")
    return fitting


def _of_tables(
    wanted: Sequence[str], sets: Sequence[str], data_root: Path | None, *, quick: bool
) -> list[Gallery]:
    """Return the galleries of the tables that are selected by name, or by the data that they use.

    Parameters
    ----------
    wanted
        Identifiers of tables; empty for all.
    sets
        Names of data sets; empty for those that the tables use.
    data_root
        The folder of the official data sets.
    quick
        Whether to take some poses of each subject alone.

    Raises
    ------
    ConfigurationError
        If a table is unknown, or tables and data sets do not belong together.
    DatasetError
        If a data set is unfit for a table that was named, or for every table that uses it.
    """
    check_known("table", wanted, [table.identifier for table in TABLES] + ["extended"])
    for table in TABLES:
        if quick and table.is_ablation and table.identifier in wanted:
            problem = f"table {table.identifier} is a mean over all folds, and --quick has one"
            raise ConfigurationError(problem, "drop --quick")

    tables_with_data = _tables_with_data(wanted, sets, data_root, quick=quick)
    if not tables_with_data:
        problem = "the selected tables have no data"
        if sets:
            problem = f"no selected table uses {', '.join(sets)}"
        raise ConfigurationError(problem, "drop -t or -d, or choose ones that belong together")
    chosen: list[Gallery] = []
    used: set[str] = set()
    refused: dict[str, DatasetError] = {}
    for table, dataset in tables_with_data:
        try:
            # A list: of a table that fails halfway, no gallery is added.
            chosen += list(_galleries(table, dataset, data_root, quick=quick))
            used.add(dataset)
        except DatasetError as error:
            # A table that accompanies another one may do without its data.
            if not table.part_of or table.identifier in wanted:
                raise
            refused.setdefault(dataset, error)
    for dataset, reason in refused.items():
        is_lost = dataset in sets or not chosen
        if is_lost and dataset not in used:
            raise reason
    return chosen


def _tables_with_data(
    wanted: Sequence[str], sets: Sequence[str], data_root: Path | None, *, quick: bool
) -> list[tuple[Table, str]]:
    """Return the selected tables, each with the name of a data set.

    Parameters
    ----------
    wanted
        Identifiers of tables; empty for all.
    sets
        Names of data sets; empty for the one that each table uses, if that is available.
    data_root
        The folder of the official data sets.
    quick
        Whether to leave out tables that quick runs do not have.
    """
    selected = [table for table in TABLES if _is_selected(table, wanted, sets, quick)]
    with_data: list[tuple[Table, str]] = []
    if sets:
        for name in sets:  # one that no table uses gets a table of its own
            with_data += [(table, name) for table in _tables_of(name, selected, own=not wanted)]
        return with_data
    for table in selected:
        name = _source(table, data_root, wanted)
        if name:
            with_data.append((table, name))
    return with_data


def _is_selected(table: Table, tables: Sequence[str], sets: Sequence[str], quick: bool) -> bool:
    """Return whether a selection includes a table, by its name, its main table or its data set."""
    if tables:
        return table.identifier in tables or (table.part_of in tables and not quick)
    if table.runs == "alone":
        return False
    if table.runs == "named":
        return not set(table.datasets).isdisjoint(sets)
    if table.runs == "quick" or not quick:
        return True
    return bool(sets) and not table.part_of and not table.is_ablation


def _source(table: Table, data_root: Path | None, asked_for: Sequence[str]) -> str:
    """Return the data set of a table.

    It is "" for one that is absent, where the table was not asked for by its name.
    """
    if is_present(table.dataset, data_root):
        return table.dataset
    if table.stand_ins:
        return table.stand_ins[0]
    return table.dataset if table.identifier in asked_for else ""


def _tables_of(name: str, selected: Iterable[Table], *, own: bool) -> list[Table]:
    """Return the tables that use a data set; if there are none, its own table on request."""
    require_known(name)
    if own and not any(name in table.datasets for table in TABLES if not table.is_robustness):
        return [own_table(table_name(name))]
    return [table for table in selected if table.shows(name) or table.is_robustness]


def _galleries(
    table: Table, name: str, data_root: Path | None, *, quick: bool
) -> Iterator[Gallery]:
    """Yield the galleries of a table on a data set: one for each fold or draw of each column.

    Parameters
    ----------
    table
        The table.
    name
        Name of the data set.
    data_root
        The folder of the official data sets.
    quick
        Whether to take some poses alone. If the table has columns over folds, the others are then
        left out.
    """
    columns = table.columns
    if quick:
        with_folds = tuple(column for column in columns if len(column.parts) > 1)
        columns = with_folds or columns
    for column in columns:
        datasets = _sets_of_column(table, column, name)
        for dataset in datasets:
            is_first = dataset == datasets[0]
            yield from _galleries_of_set(
                table, column, dataset, data_root, is_first=is_first, quick=quick
            )


def _sets_of_column(table: Table, column: GalleryGroup, name: str) -> list[str]:
    """Return the data sets of a column: all draws of one, its changes, or those of robustness."""
    if table.is_robustness:
        return _conditions(name)
    sets = [name]
    if column.over_draws and name in table.stand_ins[:1]:
        sets = [*table.stand_ins]
    if name in table.datasets:
        sets += [f"{name}{change}" for change in table.changes]
    return sets


def _galleries_of_set(
    table: Table,
    column: GalleryGroup,
    source: str,
    data_root: Path | None,
    *,
    is_first: bool,
    quick: bool,
) -> Iterator[Gallery]:
    """Yield the galleries of one column of a table on one data set, such as its folds.

    Parameters
    ----------
    table, column
        The table and its column.
    source
        Name of the data set.
    data_root
        The folder of the official data sets.
    is_first
        Whether it is the first data set of the column. Networks are tested on no other.
    quick
        Whether to take a few poses of each subject, and the first fold alone.

    Raises
    ------
    DatasetError
        If the data set is missing, or unfit for retrieval.
    """
    dataset = open_dataset(source, data_root)
    check_ranked(dataset)
    inputs = _inputs_of_column(column, dataset, is_first=is_first)
    parts = column.parts[:1] if quick else column.parts
    for part in parts:
        shapes = _shapes_of_part(dataset, part)
        other_gallery = None
        if are_queries_of_another(part):
            other_gallery = _gallery_of_queries(table, source, part, data_root, quick=quick)
        ranked = thinned(shapes, QUICK_POSES) if quick else shapes
        yield Gallery(
            table=table,
            source=source,
            dataset=dataset,
            entries=ranked,
            quick=quick,
            part=part,
            data_root=data_root,
            inputs=inputs,
            is_split=column.has_mixed_inputs,
            gallery_of_queries=other_gallery,
        )


def _inputs_of_column(
    column: GalleryGroup, dataset: ShapeSet, *, is_first: bool
) -> tuple[Input, ...]:
    """Return the inputs of a column that a data set has: surfaces, depth views or both.

    A column of mixed inputs needs views for networks, which see only its first data set.
    """
    wanted: tuple[str, ...] = (column.input,)
    if column.has_mixed_inputs:
        wanted = ("mesh", "view") if is_first else ("mesh",)
    return tuple(input_ for input_ in dataset.inputs if input_ in wanted)


def _shapes_of_part(dataset: ShapeSet, part: str) -> tuple[Entry, ...]:
    """Return the shapes of a part of a data set, such as a fold; all of them for "".

    Raises
    ------
    DatasetError
        If they rank each other, and none has another of its class to find.
    """
    shapes = Part(PARTS.get(part, ())).of(dataset)
    if not part:
        check_retrievable(dataset)
    elif not are_queries_of_another(part):
        check_retrievable(dataset, shapes)
    return shapes


def _gallery_of_queries(
    table: Table, source: str, part: str, data_root: Path | None, *, quick: bool
) -> Gallery:
    """Return the gallery in which the shapes of a table are queries.

    It holds complete surfaces, if its data set has any, or views from several cameras.

    Parameters
    ----------
    table
        The table, which may name the data set of the gallery.
    source
        Data set of the queries, and of the gallery if the table names no other.
    part
        Column of the table, which may say from how many cameras the gallery is seen.
    data_root
        The folder of the official data sets.
    quick
        Whether to take some poses alone.
    """
    name = table.gallery or source
    dataset = open_dataset(name, data_root)
    # Take off changes such as "[noise=2]" of depth views, until the set has complete surfaces.
    while "mesh" not in dataset.inputs and split_changes(name)[1]:
        name, _, _ = name.rpartition("[")
        dataset = open_dataset(name, data_root)
    entries = thinned(dataset.shapes, QUICK_POSES) if quick else dataset.shapes
    cameras = CAMERAS.get(part, table.cameras)
    inputs = ("view",) if cameras else dataset.inputs[:1]
    return Gallery(
        table=table,
        source=name,
        dataset=dataset,
        entries=entries,
        quick=quick,
        data_root=data_root,
        inputs=inputs,
        cameras=cameras,
    )


def _conditions(name: str) -> list[str]:
    """Return the name of a data set, and of each change of its meshes at three strengths."""
    conditions = [name]
    for change, facts in CHANGES.items():
        if facts.of_mesh and change != "jitter":
            levels = STRENGTHS[::2]
            conditions += [changed_name(name, change, level) for level in levels]
    return conditions


def _shape_of(entry: Entry) -> str:
    """Return the name of the shape that a view shows."""
    shape, _, _ = entry.identifier.rpartition("@")
    return shape
