"""The verb ``train``: the models of a learner, each on the data that its protocol allows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli import completion
from benchmark.cli.options import RunOptions, add_options
from benchmark.errors import ConfigurationError
from benchmark.text import say

if TYPE_CHECKING:
    from benchmark.plugins.registry import MethodSpec
    from benchmark.protocols.trainings import Training

#: Options of this verb that a method gets by their own name.
SCHEDULE = ("resolution", "epochs", "batch", "device", "threads")


@click.command()
@click.argument("method", metavar="METHOD", shell_complete=completion.methods)
@click.option("-t", "--table", default="I", show_default=True, metavar="TABLE", help="Table that the model is for.")
@click.option("--only", metavar="TRAINING", help="Train only on this, e.g. humans-strict-0-1.")
@click.option("--config", "configuration", metavar="NAME", help="Configuration of the method.")
@click.option("--seed", "training_seed", type=int, help="Seed of the training.")
@click.option("--resolution", type=click.IntRange(min=1), metavar="N", help="Pixels per side.")
@click.option("--epochs", type=click.IntRange(min=1), metavar="N", help="Passes over the pairs.")
@click.option("--batch", type=click.IntRange(min=1), metavar="N", help="Pairs per step.")
@click.option("--device", type=click.Choice(["auto", "cpu", "cuda"]), help="Where to train.")
@click.option("--threads", type=click.IntRange(min=1), metavar="N", help="Threads of a training on the CPU.")
@click.option(
    "-o", "--option", "method_options", multiple=True, metavar="NAME=VALUE", help="Further options of the method."
)
@click.option("--sampled", "n_sampled", type=click.IntRange(min=1), metavar="N", help="Number of generated bodies.")
@click.option(
    "--validation",
    "n_validation",
    type=click.IntRange(min=1),
    metavar="N",
    help="Hold back N training subjects for curves and pictures.",
)
@add_options("plugins", "results", "data_root")
def train(
    method: str,
    table: str,
    only: str | None,
    method_options: tuple[str, ...],
    n_sampled: int | None,
    n_validation: int | None,
    **given: Any,
) -> None:
    """Train the models of a learner; resume an interrupted training, and skip finished models."""
    from benchmark.api.learning import Learner
    from benchmark.api.parameters import assignments
    from benchmark.execution.processes.calls import Guard, call_apart
    from benchmark.pipeline.storage.store import Store
    from benchmark.protocols.tables import trainings_of
    from benchmark.protocols.trainings import COUNTED, SAMPLED_BODIES, find_training, with_validation

    options = RunOptions.of(given)
    spec = _learner(method, options.plugins, given["configuration"], given["training_seed"])
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise _no_learner(method, options.plugins)
    trainings = [find_training(only)] if only else trainings_of(learner, table, options.data_root)
    if n_sampled and not any(training.name in COUNTED for training in trainings):
        raise ConfigurationError(f"{spec.name} is not trained on sampled bodies here", "omit --sampled")
    if n_validation:
        trainings = [with_validation(training, n_validation) for training in trainings]
    schedule = {name: given[name] for name in SCHEDULE if given[name] is not None} | assignments(method_options)
    store = Store.open(options.results)
    guard = Guard(
        f"training {spec.name}", "correct the method, then train again: checkpoints are kept", all_memory=True
    )
    for training in trainings:
        say(f"{spec.name}, {training.name}")
        call_apart(train_one, spec, training, options, schedule, n_sampled or SAMPLED_BODIES, guard=guard, say=say)
        say(f"the model is in {store.models / training.name / learner.model_name}")


def train_one(
    spec: MethodSpec,
    training: Training,
    options: RunOptions,
    schedule: Mapping[str, Any],
    n_sampled: int,
    say: Callable[[str], None],
) -> None:
    """Train the model of one training, here.

    Parameters
    ----------
    spec
        A learner.
    training
        What to train it on.
    options
        Where models go and shapes come from.
    schedule
        Deviations from the schedule of the learner.
    n_sampled
        Bodies where they are sampled.
    say
        Told about progress.
    """
    from benchmark.api.learning import CARD, ChecksOptions, read_card
    from benchmark.pipeline.storage.store import Store
    from benchmark.protocols.pairs import training_data

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
            say(f"{error.problem}: renamed to unusable-{CARD}, training the model again")
    data = training_data(training, store, options.data_root, say, n_sampled)
    learner.train(data, folder, schedule, say)


def _learner(name: str, plugins: Iterable[Path], configuration: str | None, seed: int | None) -> MethodSpec:
    """The named method with the parameters that have options of their own."""
    from benchmark.plugins.registry import methods, variant

    spec = variant(name, methods(plugins))
    if not spec.learns:
        raise _no_learner(name, plugins)
    chosen = {"configuration": configuration, "training_seed": seed}
    return spec.with_parameters({name: value for name, value in chosen.items() if value is not None})


def _no_learner(name: str, plugins: Iterable[Path]) -> ConfigurationError:
    from benchmark.plugins.registry import methods

    learners = []
    for known, spec in methods(plugins).items():
        try:
            learners += [known] if spec.learns else []
        except ConfigurationError:
            continue  # one that cannot be imported is no help here
    return ConfigurationError(f"method '{name}' is not a learner", f"choose from {', '.join(learners) or 'a plugin'}")
