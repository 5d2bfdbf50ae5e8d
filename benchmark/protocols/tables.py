"""The tables of the paper as data: data sets, subjects and rows."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from benchmark.api.contracts import Input
from benchmark.api.learning import Learner
from benchmark.datasets.catalogue import is_present
from benchmark.datasets.official import EXTENDED
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.plugins.registry import MethodSpec
from benchmark.protocols.trainings import HELD_OUT, SUBJECT_FOLDS, TRAININGS, Training, only_training, trainings_on
from benchmark.reference import paper

INPUTS: tuple[Input, ...] = ("mesh", "view")

#: Methods outside the paper that have rows in quick runs by default: baselines that a canonical form should beat.
QUICK_CONTROLS = ("identity",)

#: Values of a parameter of learners, besides its default, over which a row is averaged if there are models.
AVERAGED: Mapping[str, tuple[int | str, ...]] = {
    "training_seed": (0, 1, 2),
    "training": ("humans-fold-1", "humans-fold-2"),
}

#: Rows of the ablation: those of the paper, and one about which it makes a claim without figures.
ABLATION = {row.method for row in paper.ABLATION} | {"learned-without-weighting"}

#: Methods that have rows only in the ablation, unless they are selected by name.
ONLY_ABLATED = ABLATION - {row.method for row in paper.ROWS}

#: Parameters of the network with the paper's pixels and epochs, which has rows only where a table names them.
AS_PRINTED: Mapping[str, str] = {"configuration": "as_printed"}

_PAPER = frozenset({"paper"})
_ALL = frozenset({"paper", "control", "extended"})


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table if no method is selected by name; a selected method has a row in every table.

    Parameters
    ----------
    families
        Families of methods without training that have rows, except those in :data:`ONLY_ABLATED`.
    learners
        Families of learners that have rows; a model of each must exist.
    names
        Other methods that have rows.
    trainings
        Trainings of additional rows by learner, by data set, if there is a model.
    averaged
        Parameter of learners over whose values a row is averaged, if there are models; "" for none.
    models
        Parameters of further rows of learners, if there is a model.
    """

    families: frozenset[str] = _ALL
    learners: frozenset[str] = _PAPER
    names: Collection[str] = ()
    trainings: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    averaged: str = ""
    models: Mapping[str, tuple[Mapping[str, str], ...]] = field(default_factory=dict)

    def quick(self) -> Rows:
        """Rows of a quick run: the methods of the paper and :data:`QUICK_CONTROLS`."""
        names = (*self.names, *QUICK_CONTROLS)
        return Rows(self.families & _PAPER, self.learners & _PAPER, names, {}, self.averaged)

    def include(self, spec: MethodSpec) -> bool:
        """Return whether a method has a row by default; one that cannot be imported has, to show the reason."""
        if spec.base_name in self.names:
            return True
        if not self.families or spec.base_name in ONLY_ABLATED:
            return False
        try:
            return spec.info.family in (self.learners if spec.learns else self.families)
        except ConfigurationError:
            return True


@dataclass(frozen=True)
class Table:
    """One table.

    Parameters
    ----------
    identifier
        The paper's numeral, or the name of a data set for its own table.
    caption
        Caption without the data and the folds.
    dataset
        Name or path of the paper's data set; "" for a table of several data sets.
    stand_in
        Generated data set that replaces it if it is missing; "" if there is none.
    any_of
        Data sets for which the table is made separately, if they are present; empty for a table of one data set.
    mean_over_sets
        Whether a row is the mean over the data sets of ``any_of``, each of which is a gallery.
    subjects
        Subjects in the gallery, by name or by index in the data set; empty for all.
    folds
        Subjects of each fold by index in the data set, if each fold is a gallery and a row is the mean over them; empty
        for a single gallery of ``subjects``.
    rows
        Methods that have rows.
    runs
        Runs that make it by default: all, full ones and quick ones that name its data set, or only those that name its
        data set.
    part_of
        Table with which it is also made; "" if there is none.
    all_unseen
        Whether it is an error if a model was trained on one of its shapes or subjects.
    ablation
        Whether its rows are only the learners that it names.
    robustness
        Whether it shows a clean data set and the same data set under each perturbation; made only if named.
    """

    identifier: str
    caption: str
    dataset: str = ""
    stand_in: str = ""
    any_of: tuple[str, ...] = ()
    mean_over_sets: bool = False
    subjects: tuple[int | str, ...] = ()
    folds: tuple[tuple[int, ...], ...] = ()
    rows: Rows = Rows()
    runs: Literal["quick", "full", "named"] = "full"
    part_of: str = ""
    all_unseen: bool = True
    ablation: bool = False
    robustness: bool = False

    @property
    def datasets(self) -> tuple[str, ...]:
        """Data sets for which it can be made."""
        return tuple(name for name in (self.dataset, self.stand_in, *self.any_of) if name)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs under which it is made: learners read only depth images."""
        return ("view",) if self.ablation else INPUTS

    def caption_over(self, n_galleries: int) -> str:
        """Return the caption for a number of galleries; with folds, it states that number."""
        if self.mean_over_sets and n_galleries > 1:
            return f"{self.caption}, mean over {_in_words(n_galleries)} draws"
        if not self.folds:
            return self.caption
        size = _in_words(len(self.folds[0]))
        folds = f"mean over {_in_words(n_galleries)} folds" if n_galleries > 1 else "one fold"
        return f"{self.caption}, {folds} of {size} subjects"

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its galleries in the data set; "" for the whole data set."""
        if self.folds:
            return tuple(f"fold {number}" for number in range(len(self.folds)))
        return ("held out",) if self.subjects else ("",)


def _in_words(number: int) -> str:
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    return words[number] if number < len(words) else str(number)


#: Rows of animals and people. Besides the trainings that the table names, learners are trained by the other
#: interpretation of the paper's "other animals", and on sampled bodies outside the data set. The latter have no row on
#: the generated animals, which are the centre of the sampled distribution.
_ANIMALS = Rows(
    models={"learned": (AS_PRINTED,)},
    trainings={
        "tosca": {"learned-wide-extra": ("animals-sampled",)},
    },
)

TABLES: tuple[Table, ...] = (
    Table(
        "I",
        "Retrieval of synthetic humans",
        dataset="shrec14-synthetic",
        stand_in="humans",
        folds=SUBJECT_FOLDS,
        rows=Rows(learners=_ALL),
        runs="quick",
    ),
    Table(
        "I-whole",
        "Retrieval of synthetic humans, all subjects in one gallery (without figures of the paper, which tests five)",
        dataset="shrec14-synthetic",
        stand_in="humans",
        rows=Rows(learners=frozenset()),
        part_of="I",
    ),
    Table(
        "I-printed",
        "Retrieval of synthetic humans by the network as printed (without figures of the paper)",
        dataset="shrec14-synthetic",
        stand_in="humans",
        # In Table I, the fold without a model would count as 0.
        folds=SUBJECT_FOLDS[:2],
        rows=Rows(families=frozenset(), names=("learned",), models={"learned": (AS_PRINTED,)}),
        part_of="I",
        ablation=True,
    ),
    Table(
        "I-random",
        "Retrieval of synthetic humans drawn at random (without figures of the paper)",
        dataset="people",
        any_of=tuple(f"people[draw={draw}]" for draw in range(3)),
        mean_over_sets=True,
        rows=Rows(families=frozenset({"paper", "control"}), averaged="training"),
    ),
    Table(
        "II",
        "Retrieval of real humans",
        dataset="shrec14-real",
        stand_in="humans-scanlike",
        rows=Rows(learners=_ALL),
    ),
    Table(
        "III",
        "Retrieval of animals and people",
        dataset="tosca",
        stand_in="animals",
        rows=_ANIMALS,
        runs="quick",
        all_unseen=False,
    ),
    Table(
        "III-held-out",
        "Retrieval of cats and horses alone, which no model of Table III was trained on (without figures of the paper: "
        "its values cannot come from so few shapes)",
        dataset="tosca",
        stand_in="animals",
        subjects=HELD_OUT,
        rows=_ANIMALS,
        part_of="III",
    ),
    Table(
        "IV",
        "Ablation of the learned method",
        dataset="shrec14-synthetic",
        stand_in="humans",
        folds=SUBJECT_FOLDS,
        rows=Rows(families=frozenset(), names=ABLATION, averaged="training_seed"),
        ablation=True,
    ),
    Table(
        "extended",
        "Retrieval on further official sets (without figures of the paper)",
        any_of=EXTENDED,
        all_unseen=False,
    ),
    Table(
        "robustness",
        "What breaks the methods: one gallery, clean and under each perturbation",
        dataset="animals-few",
        # It has 46 galleries. Least-squares and non-metric MDS are omitted, because they scale the same distances as
        # classic MDS; the input itself and two descriptors are added.
        rows=Rows(
            families=frozenset(),
            names=(
                *("classic-mds", "fast-mds", "constrained-mds", "gps", "mesh-unfolding", "skeleton"),
                *("identity", "surface-area", "shape-dna"),
            ),
        ),
        runs="named",
        all_unseen=False,
        robustness=True,
    ),
)


def trainings_of(learner: Learner, numeral: str, data_root: Path | None) -> list[Training]:
    """Return the trainings whose models a learner uses for a table of the paper.

    Parameters
    ----------
    learner, data_root
        See :func:`benchmark.protocols.trainings.trainings_on`.
    numeral
        Numeral of the table; ignored for a learner whose split does not depend on the table.

    Raises
    ------
    ConfigurationError
        If the training or the table is unknown.
    """
    if only := only_training(learner):
        return [only]
    if numeral not in paper.NUMERALS:
        raise did_you_mean("table", numeral, paper.NUMERALS)
    identifier = "I" if learner.split == "strict" else numeral
    table = next(table for table in TABLES if table.identifier == identifier)
    # A data set without trainings uses the models of another data set, which has its own stand-in.
    is_trained_on = any(training.dataset == table.dataset for training in TRAININGS.values())
    use_stand_in = is_trained_on and not is_present(table.dataset, data_root)
    return trainings_on(learner, table.stand_in if use_stand_in else table.dataset, data_root)
