"""The tables of the paper as data: which set, which subjects, under which inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmark.api.contracts import Input
from benchmark.api.learning import Learner
from benchmark.datasets.catalogue import is_present
from benchmark.datasets.official.sets import EXTENDED
from benchmark.errors import did_you_mean
from benchmark.protocols.trainings import HELD_OUT, SUBJECT_FOLDS, TRAININGS, Training, only_training, trainings_on
from benchmark.reference import paper

INPUTS: tuple[Input, ...] = ("mesh", "view")


@dataclass(frozen=True)
class Table:
    """One table.

    Parameters
    ----------
    identifier
        The paper's numeral, or the name of a data set for a table of one's own.
    caption
        What the table shows, without naming the data or the folds.
    dataset
        Name or path of the set that the paper uses; "" for a table of several sets.
    stand_in
        Generated set that takes its place when it is absent; "" if there is none.
    subjects
        Subjects in the gallery, by name or by their place in the data set; empty for all.
    folds
        Subjects of each fold by their place in the data set, where each fold is a gallery of its own and a row is the
        mean over the galleries; empty for a single gallery of ``subjects``.
    in_quick_runs
        Whether ``--quick`` makes it without being asked for it by name.
    part_of
        Table with which it is made as well; "" if it stands alone.
    all_unseen
        Whether it is an error that a model was trained on one of its shapes or subjects.
    ablation
        Whether its rows are learners, each with several seeds of its training.
    split_size
        Test subjects in each of all the ways to choose some, where the table tells how much depends on the choice; no
        learner has a row there. 0 for a table without.
    extended_learners
        Whether learners beyond the paper's have rows without being asked for by name; a model of each must exist.
    any_of
        Sets that it is made for, each on its own, as far as they are present; empty for a table of one set.
    robustness
        Whether it is made of a clean set and of that set under each perturbation, of :data:`ROBUSTNESS_ROWS` unless
        others are asked for, and by its name alone.
    only_named
        Whether it is made where it, or its set, is asked for by name alone.
    few_rows
        Whether of the methods that were not asked for by name those of the paper and controls alone have rows.
    mean_over_sets
        Whether a row is the mean over the sets of ``any_of``, each a gallery of its own.
    averaged
        Parameter of learners whose values share a row, which is their mean, as far as there are models; "" for none.
    """

    identifier: str
    caption: str
    dataset: str = ""
    stand_in: str = ""
    subjects: tuple[int | str, ...] = ()
    folds: tuple[tuple[int, ...], ...] = ()
    in_quick_runs: bool = True
    part_of: str = ""
    all_unseen: bool = True
    ablation: bool = False
    extended_learners: bool = False
    split_size: int = 0
    any_of: tuple[str, ...] = ()
    robustness: bool = False
    only_named: bool = False
    few_rows: bool = False
    averaged: str = ""
    mean_over_sets: bool = False

    @property
    def datasets(self) -> tuple[str, ...]:
        """Sets that it can be made for."""
        return tuple(name for name in (self.dataset, self.stand_in, *self.any_of) if name)

    @property
    def inputs(self) -> tuple[Input, ...]:
        """Inputs under which it is made: learners read depth images alone."""
        return ("view",) if self.ablation else INPUTS

    def caption_over(self, n_galleries: int) -> str:
        """Caption of a table made of so many of its galleries: with folds it says of how many."""
        if self.mean_over_sets and n_galleries > 1:
            return f"{self.caption}, mean over {_in_words(n_galleries)} draws"
        if not self.folds:
            return self.caption
        size = _in_words(len(self.folds[0]))
        folds = f"mean over {_in_words(n_galleries)} folds" if n_galleries > 1 else "one fold"
        return f"{self.caption}, {folds} of {size} subjects"

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its galleries inside the data set; "" for the whole set."""
        if self.folds:
            return tuple(f"fold {number}" for number in range(len(self.folds)))
        return ("held out",) if self.subjects else ("",)


def _in_words(number: int) -> str:
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    return words[number] if number < len(words) else str(number)


TABLES: tuple[Table, ...] = (
    Table(
        "I",
        "Retrieval of synthetic humans",
        "shrec14-synthetic",
        "humans",
        folds=SUBJECT_FOLDS,
        extended_learners=True,
    ),
    Table(
        "I-whole",
        "Retrieval of synthetic humans, all subjects in one gallery (without figures of the paper, which tests five)",
        "shrec14-synthetic",
        "humans",
        in_quick_runs=False,
        part_of="I",
        split_size=len(SUBJECT_FOLDS[0]),
    ),
    Table(
        "I-random",
        "Retrieval of synthetic humans drawn at random (without figures of the paper)",
        "humans-random",
        any_of=tuple(f"humans-random[draw={draw}]" for draw in range(3)),
        in_quick_runs=False,
        few_rows=True,
        averaged="training",
        mean_over_sets=True,
    ),
    Table(
        "II",
        "Retrieval of real humans",
        "shrec14-real",
        "humans-scanlike",
        in_quick_runs=False,
        extended_learners=True,
    ),
    Table("III", "Retrieval of animals and people", "tosca", "animals", all_unseen=False),
    Table(
        "III-held-out",
        "Retrieval of cats and horses alone, which no model of Table III was trained on (without figures of the paper: "
        "its values cannot come from so few shapes)",
        "tosca",
        "animals",
        HELD_OUT,
        in_quick_runs=False,
        part_of="III",
    ),
    Table(
        "IV",
        "Ablation of the learned method",
        "shrec14-synthetic",
        "humans",
        folds=SUBJECT_FOLDS,
        in_quick_runs=False,
        ablation=True,
        averaged="training_seed",
    ),
    Table(
        "extended",
        "Retrieval on further official sets (without figures of the paper)",
        any_of=EXTENDED,
        in_quick_runs=False,
        all_unseen=False,
    ),
    Table(
        "camera",
        "Retrieval of synthetic humans before a perspective depth camera (without figures of the paper)",
        "camera",
        folds=SUBJECT_FOLDS,
        in_quick_runs=False,
        extended_learners=True,
        only_named=True,
    ),
    Table(
        "robustness",
        "What breaks the methods: one gallery, clean and under each perturbation",
        "animals-few",
        in_quick_runs=False,
        all_unseen=False,
        robustness=True,
    ),
)


def trainings_of(learner: Learner, numeral: str, data_root: Path | None) -> dict[str, Training]:
    """Trainings by name that give a learner its models for a table of the paper.

    Parameters
    ----------
    learner, data_root
        See :func:`benchmark.protocols.trainings.trainings_on`.
    numeral
        Of the table; of no account for a learner whose split is not that of the table.

    Raises
    ------
    ConfigurationError
        If the training or the table is unknown.
    """
    if only := only_training(learner):
        return {only.name: only}
    if numeral not in paper.NUMERALS:
        raise did_you_mean("table", numeral, paper.NUMERALS)
    wanted = "I" if learner.split == "strict" else numeral
    table = next(table for table in TABLES if table.identifier == wanted)
    # A set that no model is trained on takes the models of another set, which has its own stand-in.
    is_trained_on = any(training.dataset == table.dataset for training in TRAININGS.values())
    use_stand_in = is_trained_on and not is_present(table.dataset, data_root)
    found = trainings_on(learner, table.stand_in if use_stand_in else table.dataset, data_root)
    return {training.name: training for training in found}
