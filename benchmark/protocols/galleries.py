"""The shapes that a table ranks against each other, and the methods that are tested on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.api.learning import Learner, find_model
from benchmark.datasets.base import Dataset, Entry, check_retrievable
from benchmark.datasets.catalogue import (
    CATALOGUE,
    check_ranked,
    fitting_perturbations,
    is_known,
    is_path,
    is_present,
    open_dataset,
    table_name,
)
from benchmark.datasets.decimated import decimated_name, parsed_decimation
from benchmark.datasets.jittered import Jittered, clean_dataset, clean_name, jittered_name
from benchmark.datasets.parts import Part, thinned
from benchmark.datasets.perturbations.dataset import PERTURBATIONS, STRENGTHS, parsed, perturbed_name
from benchmark.errors import ConfigurationError, DatasetError, did_you_mean
from benchmark.plugins.registry import MethodSpec
from benchmark.protocols.model_places import model_places
from benchmark.protocols.rows import (
    AVERAGED,
    FURTHER_TRAININGS,
    ONLY_ABLATED,
    ONLY_NAMED,
    QUICK_CONTROLS,
    ROBUSTNESS_ROWS,
    VARIANTS,
)
from benchmark.protocols.tables import TABLES, Table
from benchmark.protocols.trainings import trainings_by_shape
from benchmark.reference import paper

#: ``--quick`` keeps every k-th pose so that no subject keeps more than this many.
QUICK_POSES = 3


def gallery_name(dataset: str, part: str, *, quick: bool) -> str:
    """Name of a gallery in plans and records: the data set, the part of it, and whether poses were left out."""
    return f"{dataset}{part and ' ' + part}{' (quick)' if quick else ''}"


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
    few_rows
        Whether methods that the paper does not have are left out to save time.
    part
        Which part of the set it is in words, e.g. ``"fold 0"``; "" for the whole set.
    fold
        Number of the fold of the table that it is; None if the table has no folds.
    data_root
        The folder that holds the official sets.
    """

    table: Table
    source: str
    dataset: Dataset
    entries: tuple[Entry, ...]
    quick: bool = False
    part: str = ""
    fold: int | None = None
    data_root: Path | None = None
    few_rows: bool = False

    @property
    def name(self) -> str:
        """Name of the gallery in plans and records."""
        return gallery_name(self.dataset.name, self.part, quick=self.quick)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs under which it is ranked: those of its table, and of a perturbed gallery those of its perturbation.

        Depth images are no complete surfaces.
        """
        offered = getattr(self.dataset, "inputs", self.table.inputs)
        return _inputs_of(clean_name(self.dataset.name), tuple(each for each in self.table.inputs if each in offered))

    def check_input(self, input_: str) -> None:
        """Raise ``ConfigurationError`` for an input that was asked for and that its shapes do not have."""
        if input_ == "mesh" and "mesh" not in getattr(self.dataset, "inputs", ("mesh",)):
            raise ConfigurationError(
                f"data set '{self.dataset.name}' holds depth images, which show one side of each shape",
                "drop --input mesh: there are no complete surfaces",
            )
        if input_ == "view" and "view" not in getattr(self.dataset, "inputs", ("view",)):
            raise ConfigurationError(
                f"data set '{self.dataset.name}' has no views: a camera sees the mesh of the file, not a decimated one",
                "drop --input view, or name the set without its decimation",
            )

    def jittered(self, number: int) -> Gallery:
        """Return the same shapes, jittered for the n-th time, as a gallery of its own."""
        dataset = Jittered(self.dataset, number)
        kept = {entry.identifier for entry in self.entries}
        entries = tuple(entry for entry in dataset.entries if entry.identifier in kept)
        return replace(self, source=jittered_name(self.source, number), dataset=dataset, entries=entries)

    def rows(self, methods: Iterable[MethodSpec], trained_here: Path | None = None) -> list[MethodSpec]:
        """Methods that are tested on it, some in several variants.

        Where a row is a mean over trainings, there is one for each of which a learner has a model.

        Parameters
        ----------
        methods
            The methods that were chosen.
        trained_here
            Folder of the models that were trained here, looked at beside the shipped ones.
        """
        if not self.table.ablation:
            chosen = [row for spec in methods for row in self._with_variants(spec, trained_here)]
            averaged = [row for spec in chosen for row in self._averaged(spec, trained_here)]
            return list({row.name: row for row in averaged}.values())
        printed = {row.method for row in paper.ABLATION}
        return [
            variant
            for spec in methods
            if (spec.named or spec.base_name in printed) and spec.learns and spec.split != "sampled"
            for variant in self._averaged(spec, trained_here)
        ]

    def _averaged(self, spec: MethodSpec, trained_here: Path | None) -> list[MethodSpec]:
        """The method, and its variants with other trainings that share its row and have models for these shapes."""
        name = self.table.averaged
        if not name or not spec.learns or spec.split != "table":
            return [spec]
        parameters = spec.resolved_parameters()
        if name not in parameters or name in spec.parameters:
            return [spec]
        further = (spec.with_parameters({name: value}) for value in AVERAGED[name] if value != parameters[name])
        return [spec, *(variant for variant in further if self._has_models(variant, trained_here))]

    def _has_models(self, spec: MethodSpec, trained_here: Path | None) -> bool:
        learner = spec.create()
        if not isinstance(learner, Learner):
            return False
        try:
            trainings = trainings_by_shape(learner, clean_dataset(self.dataset), self.entries, self.data_root).values()
        except ConfigurationError:
            return False  # the row of the plain method says why
        folders = model_places(learner, trained_here)
        names = {training.name for training in trainings}
        return all(find_model(folders, name, learner.model_name) is not None for name in names)

    def _has_row(self, spec: MethodSpec) -> bool:
        """Return whether a method that was not asked for by name has a row in a table that is no ablation."""
        if self.table.robustness:
            return spec.base_name in ROBUSTNESS_ROWS
        if spec.base_name in ONLY_ABLATED | ONLY_NAMED:
            return False
        try:
            if self.table.split_size and spec.learns:
                return False
            if self.table.few_rows and spec.info.family == "extended":
                return False
            if self.few_rows and spec.info.family != "paper" and spec.base_name not in QUICK_CONTROLS:
                return False
            return self.table.extended_learners or not spec.learns or spec.info.family == "paper"
        except ConfigurationError:
            return True  # what cannot be imported says so in its row

    def _with_variants(self, spec: MethodSpec, trained_here: Path | None) -> list[MethodSpec]:
        own = [spec] if spec.named or self._has_row(spec) else []
        if spec.named or spec.parameters or self.few_rows or self.table.few_rows:
            return own
        known = ROBUSTNESS_ROWS if self.table.robustness else VARIANTS
        further = known.get(spec.base_name, ()) if own else ()
        name = clean_name(self.dataset.name)
        of_set = () if self.table.robustness else FURTHER_TRAININGS.get(name, {}).get(spec.base_name, ())
        trained = (spec.with_parameters({"training": name}) for name in of_set)
        return [
            *own,
            *(spec.with_parameters(parameters) for parameters in further),
            *(variant for variant in trained if self._has_models(variant, trained_here)),
        ]


def galleries(
    table_names: Iterable[str] = (),
    dataset_names: Iterable[str] = (),
    data_root: Path | None = None,
    quick: bool = False,
    repeat: int = 0,
) -> list[Gallery]:
    """Choose the galleries that a selection on the command line stands for.

    The paper's set is used when it is present and its stand-in otherwise, never both in one table. A table that goes
    with another one is left out where the set lacks its classes, unless it was asked for by its name.

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
        Keep at most :data:`QUICK_POSES` poses of each subject, of a table with folds the first one, and of methods that
        were not asked for by name those of the paper and :data:`QUICK_CONTROLS`.
    repeat
        Jittered preparations of each gallery that go with it, but for those perturbed or decimated.

    Raises
    ------
    ConfigurationError
        If a name is unknown, the selection is empty, or an ablation is to be quick.
    DatasetError
        If a set is absent or unreadable, or what a table ranks of it is not fit for retrieval.
    """
    known = {table.identifier: table for table in TABLES}
    wanted_tables, wanted_sets = list(table_names), list(dataset_names)
    for name in wanted_tables:
        if name not in known:
            raise did_you_mean("table", name, known)
        if quick and known[name].ablation:
            raise ConfigurationError(f"table {name} is a mean over all folds, and --quick has one", "drop --quick")
    made = [table for table in known.values() if _is_made(table, wanted_tables, wanted_sets, quick)]
    chosen = [(table, name) for table in made for name in _sources(table, data_root, wanted_tables)]
    if wanted_sets:
        chosen = [(table, name) for name in wanted_sets for table in _tables_of(name, made, own=not wanted_tables)]
        further = [(table, name) for table in made if table.robustness for name in wanted_sets]
        chosen += [(replace(table, dataset=name), name) for table, name in further if name != table.dataset]
        if not chosen:
            raise ConfigurationError(
                f"no selected table uses {', '.join(wanted_sets)}", "drop -t or -d, or choose ones that belong together"
            )
    chosen = [(table, each) for table, name in chosen for each in (_conditions(name) if table.robustness else [name])]
    found: list[Gallery] = []
    for table, name in chosen:
        try:
            found += _galleries(table, name, data_root, quick)
        except DatasetError:
            if not table.part_of or table.identifier in wanted_tables:
                raise
    repeated = [gallery for gallery in found if not _is_derived(gallery.dataset.name)]
    return found + [gallery.jittered(number) for gallery in repeated for number in range(1, repeat + 1)]


def _is_derived(name: str) -> bool:
    """Return whether a set is perturbed or decimated: a jitter would come after that and tell too small a spread."""
    return parsed(name) is not None or parsed_decimation(name) is not None


def _is_made(table: Table, tables: list[str], sets: list[str], quick: bool) -> bool:
    """Return whether a selection includes a table: by its numeral, or by its set unless the table goes with others."""
    if table.identifier in tables or (table.only_named and not tables and set(table.datasets) & set(sets)):
        return True
    if table.robustness or table.only_named:
        return False
    named = bool(sets) and not table.part_of and not table.ablation
    return (not tables or table.part_of in tables) and (table.in_quick_runs or not quick or named)


def _sources(table: Table, data_root: Path | None, asked_for: Iterable[str]) -> list[str]:
    """Sets that a table is made for; of several, those that are present, and an error if it is asked for in vain."""
    if not table.any_of:
        return [table.dataset if is_present(table.dataset, data_root) or not table.stand_in else table.stand_in]
    present = [name for name in table.any_of if is_present(name, data_root)]
    if not present and table.identifier in asked_for:
        absent = ", ".join(f"{name} ({CATALOGUE[name].folder}/)" for name in table.any_of)
        raise DatasetError(
            f"table {table.identifier} has no data: of its sets none is at {data_root or 'DATA_ROOT'}: {absent}",
            "put one there and pass --data-root; 'data list --json' says where each is given out",
        )
    return present


def _tables_of(name: str, made: Iterable[Table], *, own: bool) -> list[Table]:
    """Tables that use a set; where none does, one of its own if that is wanted."""
    if not is_known(name) and not is_path(name) and not parsed_decimation(name) and not parsed(name):
        raise did_you_mean("data set", name, CATALOGUE)
    if any(name in table.datasets for table in TABLES if not table.robustness) or not own:
        return [table for table in made if name in table.datasets]
    own_name = _own_table_name(name)
    if any(own_name == table.identifier for table in TABLES):
        own_name += "-folder"
    return [Table(own_name, f"Retrieval on {own_name}", name, all_unseen=False)]


def _galleries(table: Table, name: str, data_root: Path | None, quick: bool) -> list[Gallery]:
    dataset = open_dataset(name, data_root)
    check_ranked(dataset)
    check_retrievable(dataset)

    def gallery(subjects: tuple[int | str, ...], part: str = "", fold: int | None = None) -> Gallery:
        entries = Part(subjects).of(dataset)
        check_retrievable(dataset, entries if part else None)
        kept = thinned(entries, QUICK_POSES) if quick else entries
        return Gallery(table, name, dataset, kept, len(kept) < len(entries), part, fold, data_root, few_rows=quick)

    if not table.folds:
        return [gallery(table.subjects, table.parts[0])]
    folds = [gallery(places, table.parts[number], number) for number, places in enumerate(table.folds)]
    return folds[:1] if quick else folds


def _conditions(name: str) -> list[str]:
    """A clean set, and the same set under each perturbation at each strength, by name or path."""
    fitting = fitting_perturbations(name)
    return [name, *(perturbed_name(name, each, strength) for each in fitting for strength in STRENGTHS)]


def _inputs_of(dataset: str, inputs: tuple[Input, ...]) -> tuple[Input, ...]:
    """Inputs under which a data set is ranked: those of its table that its perturbation is made for."""
    found = parsed(dataset)
    return tuple(input_ for input_ in inputs if not found or input_ in PERTURBATIONS[found[1]].inputs)


def _own_table_name(name: str) -> str:
    """Name of the table of a set that no other table uses: that of the set, also where it is given by a path."""
    if decimation := parsed_decimation(name):
        return decimated_name(_own_table_name(decimation[0]), decimation[1])
    if found := parsed(name):
        return perturbed_name(_own_table_name(found[0]), *found[1:])
    if is_known(name) and name not in CATALOGUE:
        return open_dataset(name, None).name
    return table_name(name)
