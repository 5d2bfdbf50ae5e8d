"""``check`` and ``train``: test plugins and train learners."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmark.api.learning import CARD, Learner, read_card
from benchmark.api.parameters import assignments
from benchmark.check import check as run_check
from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.protocols.galleries import galleries
from benchmark.protocols.pairs import training_data
from benchmark.protocols.trainings import TRAININGS, Training, own_training, trainings_by_shape
from benchmark.reference.paper import NUMERALS
from benchmark.registry import find, methods, select_one
from benchmark.text import say, say_lines


def check(
    target: str, chosen: Sequence[str], assigned: Sequence[str], plugins: Sequence[Path], timeout: float,
    *, traceback: bool = False,
) -> bool:  # fmt: skip
    """Print the results of the checks of a method or file, and the error of a failed one in full if asked."""
    plugins = [*plugins, *([Path(target)] if chosen else [])]
    failed = False
    for component in [component for name in chosen or (target,) for component in find(name, plugins)]:
        for finding in run_check(component, assignments(assigned), timeout):
            say(f"{component.name}  {finding}")
            failed |= finding.outcome == "failed"
            if traceback:
                say_lines(finding.traceback)
            elif finding.traceback:
                say("'check --traceback' prints the error in full", err=True)
    return not failed


def train(
    method: str, options: Selection, target: str, assigned: Sequence[str], own: Path | None = None, hold_out: str = ""
) -> None:
    """Train the missing models.

    Parameters
    ----------
    method, options
        The learner, plugins, results folder and data root.
    target
        Table that the models are for, or name of a training.
    assigned
        Settings that differ from the learner's schedule, ``NAME=VALUE`` each.
    own, hold_out
        Folder of the user's own data, and subjects that are held out from it, with commas between them.
    """
    spec = select_one(method, options.plugins)
    learner = spec.create() if spec.learns else None
    if not isinstance(learner, Learner):
        names = ", ".join(_learners(options.plugins)) or "a plugin"
        raise ConfigurationError(f"method '{method}' is not a learner", f"choose from {names}")
    schedule = {name: _number(value) for name, value in assignments(assigned).items()}
    if own is not None:
        trainings = [own_training(own, tuple(filter(None, hold_out.split(","))))]
    elif target in NUMERALS:
        trainings = _trainings_of(learner, target, options.require_data_root())
    elif target in TRAININGS:
        trainings = [TRAININGS[target]]
    else:
        raise did_you_mean("table or training", target, [*NUMERALS, *TRAININGS])
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        folder = options.results / "models" / training.name / learner.model_name
        train_one(learner, training, folder, options.data_root, schedule, say)
        say(f"the model is in {folder}")


def _trainings_of(learner: Learner, table: str, data_root: Path | None) -> list[Training]:
    """Return the trainings whose models a run of a table uses."""
    of_shapes = (
        trainings_by_shape(learner, gallery.dataset, gallery.entries, data_root)
        for gallery in galleries([table], data_root=data_root)
    )
    return list(dict.fromkeys(training for of_shape in of_shapes for training in of_shape.values()))


def train_one(
    learner: Learner, training: Training, folder: Path, data_root: Path | None, schedule: Mapping[str, Any],
    report: Callable[[str], None],
) -> None:  # fmt: skip
    """Train one model into a folder; an unusable one there is trained again."""
    if (folder / CARD).is_file():
        try:
            read_card(folder)
        except ConfigurationError as error:
            (folder / CARD).replace(folder / f"unusable-{CARD}")
            report(f"{error.problem}: renamed to unusable-{CARD}, training the model again")
    learner.train(training_data(training, data_root, report), folder, schedule, report)


def _number(text: str) -> int | float | str:
    """Return a value of an option: a number where it is one."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _learners(plugins: Iterable[Path]) -> Iterable[str]:
    for name, component in methods(plugins).items():
        with suppress(ConfigurationError):  # a method that cannot be imported is no help here
            if component.learns:
                yield name
