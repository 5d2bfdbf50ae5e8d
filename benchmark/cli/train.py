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
from benchmark.errors import ConfigurationError
from benchmark.protocols.tables import trainings_of
from benchmark.protocols.trainings import Training, find_training, own_training
from benchmark.registry import find, methods, select_one
from benchmark.text import say, say_lines


def check(
    target: str, chosen: Sequence[str], assigned: Sequence[str], plugins: Sequence[Path], timeout: float,
    *, traceback: bool = False,
) -> bool:  # fmt: skip
    """Print the results of the checks of a method or file, and the error of a failed one in full if asked."""
    names = chosen or (target,)
    plugins = [*plugins, *([Path(target)] if chosen else [])]
    failed = False
    for component in [component for name in names for component in find(name, plugins)]:
        for finding in run_check(component, assignments(assigned), timeout):
            say(f"{component.name}  {finding}")
            failed |= finding.outcome == "failed"
            if traceback:
                say_lines(finding.traceback)
            elif finding.traceback:
                say("'check --traceback' prints the error in full", err=True)
    return not failed


def train(
    method: str, options: Selection, table: str, only: str, own: tuple[Path | None, Sequence[str], Path | None],
    assigned: Sequence[str],
) -> None:  # fmt: skip
    """Train the missing models.

    Parameters
    ----------
    method, options, table, only, assigned
        As on the command line.
    own
        Folder of the user's own data, subjects that are held out from it, and folder of a model to begin with.
    """
    spec = select_one(method, options.plugins)
    if not spec.learns:
        raise _no_learner(method, options.plugins)
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise _no_learner(method, options.plugins)
    schedule: dict[str, Any] = {name: _number(value) for name, value in assignments(assigned).items()}
    folder, hold_out, init = own
    if folder is not None:
        trainings = [own_training(folder, hold_out)]
    else:
        trainings = [find_training(only)] if only else trainings_of(learner, table, options.require_data_root())
    if init is not None:
        schedule["init"] = str(init)
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        place = options.results / "models" / training.name / learner.model_name
        train_one(learner, training, place, options.data_root, schedule, say)
        say(f"the model is in {place}")


def train_one(
    learner: Learner, training: Training, folder: Path, data_root: Path | None, schedule: Mapping[str, Any],
    report: Callable[[str], None],
) -> None:  # fmt: skip
    """Train one model.

    Parameters
    ----------
    learner, training
        The learner and its training.
    folder
        Folder of the model.
    data_root
        The folder of the official data sets.
    schedule
        Settings that differ from the learner's schedule.
    report
        Progress callback; gets lines.
    """
    from benchmark.protocols.pairs import training_data

    if (folder / CARD).is_file():
        try:
            read_card(folder)
        except ConfigurationError as error:  # an unusable model must not stop its own training
            (folder / CARD).replace(folder / f"unusable-{CARD}")
            report(f"{error.problem}: renamed to unusable-{CARD}, training the model again")
    learner.train(training_data(training, data_root, report), folder, schedule, report)


def _number(text: str) -> int | float | str:
    """Return a value of an option: a number where it is one."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text


def _no_learner(name: str, plugins: Iterable[Path]) -> ConfigurationError:
    learners = []
    for known, spec in methods(plugins).items():
        try:
            learners += [known] if spec.learns else []
        except ConfigurationError:
            continue  # a method that cannot be imported is no help here
    return ConfigurationError(f"method '{name}' is not a learner", f"choose from {', '.join(learners) or 'a plugin'}")
