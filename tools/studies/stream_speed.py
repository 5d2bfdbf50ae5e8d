"""``python -m tools.studies.stream_speed``: processor seconds of a step of the streamed networks, bodies and network.

The configurations take turns, and the least of several rounds counts, for other work on a machine only ever adds.
"""

from __future__ import annotations

from benchmark.threads import pin_threads

pin_threads()

import time  # noqa: E402
from collections.abc import Callable, Mapping  # noqa: E402
from dataclasses import replace  # noqa: E402

import click  # noqa: E402
import torch  # noqa: E402
from torch import nn  # noqa: E402

from benchmark.api.streaming import MakesFresh  # noqa: E402
from benchmark.datasets.varied.sampler import Sampler  # noqa: E402
from benchmark.datasets.varied.wide import WideSampler  # noqa: E402
from benchmark.jobs.pairs.stream import TRAINED, VIEWS  # noqa: E402
from benchmark.report.escaping import markdown_table  # noqa: E402
from learned.streamed.configuration import STREAMED, Streamed  # noqa: E402
from learned.streamed.images import MakesImages  # noqa: E402
from learned.streamed.losses import weighted  # noqa: E402
from learned.streamed.network import build_streamed  # noqa: E402
from learned.streamed.training import batch_losses  # noqa: E402
from learned.training.loop import Plan  # noqa: E402
from learned.training.machine import has_bfloat16, keep_freed_memory  # noqa: E402

CPU = torch.device("cpu")
TWO_SIDED, PEOPLE = STREAMED["two-sided"], STREAMED["people"]

#: What is compared, in the order in which it was changed.
COMPARED: Mapping[str, tuple[Streamed, MakesFresh]] = {
    "`two-sided`": (TWO_SIDED, Sampler(TRAINED)),
    "on wide bodies, one view": (replace(TWO_SIDED, stream="wide"), WideSampler(seed=TRAINED)),
    "norm of a sample": (replace(TWO_SIDED, stream="wide", norm="sample"), WideSampler(seed=TRAINED)),
    "no norm": (replace(TWO_SIDED, stream="wide", norm="none"), WideSampler(seed=TRAINED)),
    "decoder `shuffle`": (
        replace(TWO_SIDED, stream="wide", norm="none", decoder="shuffle"),
        WideSampler(seed=TRAINED),
    ),
    "`people`, one view": (PEOPLE, WideSampler(seed=TRAINED)),
    "`people`": (PEOPLE, WideSampler(seed=TRAINED, views=VIEWS)),
}


@click.command()
@click.option("--rounds", type=click.IntRange(1), default=5, show_default=True)
@click.option("--bodies", type=click.IntRange(2), default=Plan.bodies, show_default=True, help="Bodies of a step.")
def main(rounds: int, bodies: int) -> None:
    """Print images, milliseconds of a step and how many bodies and images that makes in an hour."""
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    keep_freed_memory()
    makers = {name: MakesImages(make, chosen, bodies) for name, (chosen, make) in COMPARED.items()}
    steps = {name: step_of(chosen) for name, (chosen, _) in COMPARED.items()}
    made, trained, images = {}, {}, {}
    for number in range(rounds + 1):
        for name, make in makers.items():
            began = time.process_time()
            batch = make(number)
            between = time.process_time()
            steps[name](batch)
            if number:  # The first round compiles, loads and warms up.
                made[name] = min(made.get(name, 1e9), between - began)
                trained[name] = min(trained.get(name, 1e9), time.process_time() - between)
                images[name] = len(batch.images)
    head = ("", "images", "ms for bodies", "ms for the network", "bodies an hour", "images an hour")
    body = []
    for name in COMPARED:
        hourly = 3600 / (made[name] + trained[name])
        cells = (images[name], 1000 * made[name], 1000 * trained[name], bodies * hourly, images[name] * hourly)
        body.append([name, *(f"{cell:.0f}" for cell in cells)])
    print("\n".join(markdown_table(head, body)))


def step_of(chosen: Streamed) -> Callable[..., None]:
    """Return what takes a batch and makes a step of a training on it."""
    network = build_streamed(chosen).to(memory_format=torch.channels_last)
    optimiser = torch.optim.Adam(network.parameters())

    def step(batch) -> None:
        terms = batch_losses(network, chosen, batch, CPU, has_bfloat16(CPU))
        optimiser.zero_grad()
        weighted(terms, chosen).backward()
        nn.utils.clip_grad_norm_(network.parameters(), Plan.gradient_clip)
        optimiser.step()

    return step


if __name__ == "__main__":
    main()
