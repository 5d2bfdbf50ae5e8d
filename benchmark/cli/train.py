"""``check`` and ``train``: a method of one's own, tested and trained."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import click

from benchmark.api.learning import CARD, ChecksOptions, Learner, read_card
from benchmark.api.parameters import assignments
from benchmark.cli.declare import METHOD, argument, complete_methods_and_files, option, timeout_option
from benchmark.cli.options import RunOptions, shared, verb
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.conformance import Target, check_apart
from benchmark.plugins.registry import MethodSpec, methods, variant
from benchmark.protocols.tables import trainings_of
from benchmark.protocols.trainings import COUNTED, SAMPLED_BODIES, Training, find_training, with_validation
from benchmark.text import say, say_lines

_COUNT = click.IntRange(min=1)


@verb
def check(
    target: str = argument("METHOD|FILE", shell_complete=complete_methods_and_files),
    chosen: tuple[str, ...] = option(
        "-m", "--method", multiple=True, metavar="METHOD", help="Check only this method of a file."
    ),
    assigned: tuple[str, ...] = option(
        "-o", "--option", multiple=True, metavar="NAME=VALUE", help="Option for training a learner."
    ),
    plugins: tuple[Path, ...] = shared("plugins"),
    timeout: float = timeout_option("one check"),
) -> bool:
    """Test the contract of a method, or of everything in a plugin file; exit 1 if it fails.

    Append parameters to either: FILE[power=1].
    """
    schedule = tuple(assignments(assigned).items())
    report = check_apart(Target(target, chosen, tuple(map(str, plugins)), schedule), timeout)
    say_lines(str(report))
    return bool(report)


@verb
def train(
    method: str = METHOD,
    table: str = option("-t", "--table", default="I", metavar="TABLE", help="Table that the model is for."),
    only: str | None = option("--only", metavar="TRAINING", help="Train only on this, e.g. humans-strict-0-1."),
    configuration: str | None = option("--config", metavar="NAME", help="Configuration of the method."),
    training_seed: int | None = option("--seed", type=int, help="Seed of the training."),
    resolution: int | None = option("--resolution", type=_COUNT, metavar="N", help="Pixels per side."),
    epochs: int | None = option("--epochs", type=_COUNT, metavar="N", help="Passes over the pairs."),
    batch: int | None = option("--batch", type=_COUNT, metavar="N", help="Pairs per step."),
    device: str | None = option("--device", type=click.Choice(["auto", "cpu", "cuda"]), help="Where to train."),
    threads: int | None = option("--threads", type=_COUNT, metavar="N", help="Threads of a training on the CPU."),
    assigned: tuple[str, ...] = option(
        "-o", "--option", multiple=True, metavar="NAME=VALUE", help="Further options of the method."
    ),
    n_sampled: int | None = option("--sampled", type=_COUNT, metavar="N", help="Number of generated bodies."),
    n_validation: int | None = option(
        "--validation", type=_COUNT, metavar="N", help="Hold back N training subjects for curves and pictures."
    ),
    options: RunOptions = shared("plugins", "results", "data_root"),
) -> None:
    """Train the models of a learner; resume an interrupted training, and skip finished models."""
    spec = variant(method, methods(options.plugins))
    if not spec.learns:
        raise _no_learner(method, options.plugins)
    parameters = {"configuration": configuration, "training_seed": training_seed}
    spec = spec.with_parameters({name: value for name, value in parameters.items() if value is not None})
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise _no_learner(method, options.plugins)
    trainings = [find_training(only)] if only else trainings_of(learner, table, options.data_root)
    if n_sampled and not any(training.name in COUNTED for training in trainings):
        raise ConfigurationError(f"{spec.name} is not trained on sampled bodies here", "omit --sampled")
    if n_validation:
        trainings = [with_validation(training, n_validation) for training in trainings]
    of_verb = {"resolution": resolution, "epochs": epochs, "batch": batch, "device": device, "threads": threads}
    schedule = {name: value for name, value in of_verb.items() if value is not None} | assignments(assigned)
    store = Store.open(options.results)
    guard = Guard(
        f"training {spec.name}", "correct the method, then train again: checkpoints are kept", all_memory=True
    )
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        call_apart(train_one, spec, training, options, schedule, n_sampled or SAMPLED_BODIES, guard=guard, say=say)
        say(f"the model is in {store.models / training.name / learner.model_name}")


def train_one(
    spec: MethodSpec, training: Training, options: RunOptions, schedule: Mapping[str, Any], n_sampled: int,
    report: Callable[[str], None],
) -> None:  # fmt: skip
    """Train the model of one training, here.

    Parameters
    ----------
    spec, training
        A learner, and what to train it on.
    options
        Where models go and shapes come from.
    schedule
        Deviations from the schedule of the learner.
    n_sampled
        Bodies where they are sampled.
    report
        Called with lines of progress.
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
        except ConfigurationError as error:  # as of a model that no verb can use: it would stop this training, too
            (folder / CARD).replace(folder / f"unusable-{CARD}")
            report(f"{error.problem}: renamed to unusable-{CARD}, training the model again")
    data = training_data(training, store, options.data_root, report, n_sampled)
    learner.train(data, folder, schedule, report)


def _no_learner(name: str, plugins: Iterable[Path]) -> ConfigurationError:
    learners = []
    for known, spec in methods(plugins).items():
        try:
            learners += [known] if spec.learns else []
        except ConfigurationError:
            continue  # one that cannot be imported is no help here
    return ConfigurationError(f"method '{name}' is not a learner", f"choose from {', '.join(learners) or 'a plugin'}")
