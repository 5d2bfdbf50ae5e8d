"""``check`` and ``train``: test plugins and train learners."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmark.api.learning import CARD, ChecksOptions, Learner, read_card
from benchmark.api.parameters import assignments
from benchmark.check import check as run_check
from benchmark.cli.options import Selection
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import call_apart
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import MethodSpec, methods, variant
from benchmark.protocols.tables import trainings_of
from benchmark.protocols.trainings import COUNTED, SAMPLED_BODIES, Training, find_training, with_validation
from benchmark.registry import find
from benchmark.text import say


def check(target: str, chosen: Sequence[str], assigned: Sequence[str], plugins: Sequence[Path], timeout: float) -> bool:
    """Print the results of the checks of a method or file."""
    names = chosen or (target,)
    plugins = [*plugins, *([Path(target)] if chosen else [])]
    failed = False
    for component in [component for name in names for component in find(name, plugins)]:
        for finding in run_check(component, assignments(assigned), timeout):
            say(f"{component.name}  {finding}")
            failed |= finding.outcome == "failed"
    return not failed


def train(
    method: str, options: Selection, table: str, only: str, parameters: Mapping[str, Any], assigned: Sequence[str],
    n_sampled: int | None, n_validation: int | None,
) -> None:  # fmt: skip
    """Train the missing models."""
    spec = variant(method, methods(options.plugins))
    if not spec.learns:
        raise _no_learner(method, options.plugins)
    spec = spec.with_parameters({name: value for name, value in parameters.items() if value is not None})
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise _no_learner(method, options.plugins)
    trainings = [find_training(only)] if only else trainings_of(learner, table, options.require_data_root())
    if n_sampled and not any(training.name in COUNTED for training in trainings):
        raise ConfigurationError(f"{spec.name} is not trained on sampled bodies here", "omit --sampled")
    if n_validation:
        trainings = [with_validation(training, n_validation) for training in trainings]
    schedule = {name: _number(value) for name, value in assignments(assigned).items()}
    store = Store.open(options.results)
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        call_apart(
            train_one, spec, training, options, schedule, n_sampled or SAMPLED_BODIES,
            what=f"training {spec.name}", hint="correct the method, then train again: checkpoints are kept",
            all_memory=True, say=say,
        )  # fmt: skip
        say(f"the model is in {store.models / training.name / learner.model_name}")


def train_one(
    spec: MethodSpec, training: Training, options: Selection, schedule: Mapping[str, Any], n_sampled: int,
    report: Callable[[str], None],
) -> None:  # fmt: skip
    """Train one model in this process.

    Parameters
    ----------
    spec, training
        The learner and its training.
    options
        Options of the command: folders of models and data.
    schedule
        Settings that differ from the learner's schedule.
    n_sampled
        Number of sampled bodies, if bodies are sampled.
    report
        Progress callback; gets lines.
    """
    from benchmark.protocols.pairs import training_data  # torch alone takes a second to import

    learner: Any = spec.create()
    if isinstance(learner, ChecksOptions):
        learner.check_options(schedule)
    store = Store.open(options.results)
    folder = store.models / training.name / learner.model_name
    if (folder / CARD).is_file():
        try:
            read_card(folder)
        except ConfigurationError as error:  # an unusable model must not stop its own training
            (folder / CARD).replace(folder / f"unusable-{CARD}")
            report(f"{error.problem}: renamed to unusable-{CARD}, training the model again")
    data = training_data(training, store, options.data_root, report, n_sampled)
    learner.train(data, folder, schedule, report)


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
