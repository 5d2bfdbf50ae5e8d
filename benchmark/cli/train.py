"""The verb ``train``: the models of a learner, each on the data that its protocol allows."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli.options import data_root_option, plugin_option
from benchmark.errors import ConfigurationError
from benchmark.parameters.values import assignments
from benchmark.system.text import say

if TYPE_CHECKING:
    from benchmark.methods.registry import MethodSpec

#: Options of this verb that a method gets by their own name.
SCHEDULE = ("resolution", "epochs", "batch", "device", "threads")


@click.command()
@click.argument("method", metavar="METHOD")
@click.option("-t", "--table", default="I", show_default=True, metavar="TABLE", help="Table that the model is for.")
@click.option("--only", metavar="TRAINING", help="Train on this alone, e.g. humans-strict-0-1.")
@click.option("--config", "configuration", metavar="NAME", help="Configuration of the method.")
@click.option("--seed", "training_seed", type=int, help="Seed of the training.")
@click.option("--resolution", type=click.IntRange(min=1), metavar="N", help="Pixels per side.")
@click.option("--epochs", type=click.IntRange(min=1), metavar="N", help="Passes over the pairs.")
@click.option("--batch", type=click.IntRange(min=1), metavar="N", help="Pairs per step.")
@click.option("--device", type=click.Choice(["auto", "cpu", "cuda"]), help="Where to train.")
@click.option("--threads", type=click.IntRange(min=1), metavar="N", help="Threads of a training on the CPU.")
@click.option("-o", "--option", "options", multiple=True, metavar="NAME=VALUE", help="Further options of the method.")
@click.option("--sampled", "n_sampled", type=click.IntRange(min=1), metavar="N", help="Bodies where they are sampled.")
@plugin_option
@click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    metavar="DIR",
    help="Models go to DIR/models.",
)
@data_root_option
def train(
    method: str,
    table: str,
    only: str | None,
    options: tuple[str, ...],
    n_sampled: int | None,
    plugins: tuple[Path, ...],
    results: Path,
    data_root: Path | None,
    **given: Any,
) -> None:
    """Train the models of a learner; an interrupted training goes on, a finished model is left alone."""
    from benchmark.jobs.training_pairs import training_data
    from benchmark.learning import Learner
    from benchmark.protocols.trainings import SAMPLED_BODIES, find_training, trainings_of
    from benchmark.storage.store import Store

    spec = _learner(method, plugins, given["configuration"], given["training_seed"])
    learner = spec.create()
    if not isinstance(learner, Learner):
        raise _no_learner(method, plugins)
    trainings = [find_training(only)] if only else trainings_of(learner, table, data_root).values()
    schedule = {name: given[name] for name in SCHEDULE if given[name] is not None} | assignments(options)
    store = Store.open(results)
    for training in trainings:
        folder = store.models / training.name / learner.model_name
        say(f"{spec.name}, {training.name}")
        data = training_data(training, store, data_root, say, n_sampled or SAMPLED_BODIES)
        learner.train(data, folder, schedule, say)
        say(f"the model is in {folder}")


def _learner(name: str, plugins: Iterable[Path], configuration: str | None, seed: int | None) -> MethodSpec:
    """The named method with the parameters that have options of their own."""
    from benchmark.methods.registry import methods, variant

    spec = variant(name, methods(plugins))
    if not spec.learns:
        raise _no_learner(name, plugins)
    chosen = {"configuration": configuration, "training_seed": seed}
    return spec.with_parameters({name: value for name, value in chosen.items() if value is not None})


def _no_learner(name: str, plugins: Iterable[Path]) -> ConfigurationError:
    from benchmark.methods.registry import methods

    learners = []
    for known, spec in methods(plugins).items():
        try:
            learners += [known] if spec.learns else []
        except ConfigurationError:
            continue  # one that cannot be imported is no help here
    return ConfigurationError(f"method '{name}' does not learn", f"choose from {', '.join(learners) or 'a plugin'}")
