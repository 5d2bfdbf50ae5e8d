"""Time to train the paper's network and to predict with it, against plain torch: float32, contiguous memory.

Weights and images are random: neither matters to the time.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import torch

from learned.images import enlarge, shrink
from learned.paired.configuration import LITERAL
from learned.paired.model import predict
from learned.paired.network import build
from learned.paired.pairs import Pairs
from learned.paired.schedule import Schedule, losses
from learned.paired.training import train
from learned.training.loop import TrainingRun
from learned.training.machine import Precision
from tests.learned.toy import person
from tools.speed._timing import least_seconds, processor_seconds, row

BATCH = 8
PAPER = Schedule()
PAPER_PAIRS = 200
MOST_SECONDS = 0.5
TIMES_FASTER = 1.5
LARGEST_DIFFERENCE = {"float32": 1e-3, "bfloat16": 2e-2}
REPEATS = 3
WARM_UP = 64

Run = Callable[[Pairs, Schedule], float]


def random_batch(resolution: int) -> Pairs:
    """One batch of noise, with half of the pixels in the mask."""
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(BATCH, 1, resolution, resolution, generator=generator)
    targets = torch.rand(BATCH, 2, resolution, resolution, generator=generator).round()
    return Pairs(tuple(map(str, range(BATCH))), images, targets, torch.arange(BATCH))


def plan(resolution: int, precision: Precision, steps: int) -> Schedule:
    """As many epochs as steps, for each has one batch."""
    return Schedule(resolution=resolution, epochs=steps, early_epochs=0, batch=BATCH, precision=precision)


def ours(batch: Pairs, schedule: Schedule) -> float:
    """Run the training loop; returns the loss of the last step."""
    with tempfile.TemporaryDirectory() as folder:
        here = TrainingRun(folder=Path(folder), recipe={}, seed=0, device=torch.device("cpu"), say=lambda _: None)
        result = train(LITERAL, schedule, batch, None, here)
    return float(result.progress.history[-1]["loss"])


def plain(batch: Pairs, schedule: Schedule) -> float:
    """Run the loop of a tutorial; returns the loss of the last step."""
    network = build(LITERAL)
    optimiser = torch.optim.Adam(network.parameters(), lr=schedule.learning_rate)
    for _ in range(schedule.epochs):
        optimiser.zero_grad()
        loss = torch.stack(losses(network(batch.images), batch.targets, "all")).sum()
        loss.backward()
        optimiser.step()
    return float(loss.item())


def step_seconds(run: Run, batch: Pairs, precision: Precision, more: int, repeats: int) -> float:
    """Time of one step: the difference between a training of one step and a longer one, over the steps of that."""
    resolution = batch.images.shape[-1]
    run(random_batch(WARM_UP), plan(WARM_UP, precision, 1))
    short, long = (
        min(processor_seconds(partial(run, batch, plan(resolution, precision, steps))) for _ in range(repeats))
        for steps in (1, 1 + more)
    )
    return (long - short) / more


def step_seconds_apart(run: Run, batch: Pairs, precision: Precision, more: int, repeats: int) -> float:
    """The same in a new process."""
    return apart(step_seconds, run, batch, precision, more, repeats)


def apart(measured: Callable[..., float], *arguments: Any) -> float:
    """Call in a new process: our loop changes, for the whole of its process, how memory is allocated."""
    new = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=new, initializer=torch.set_num_threads, initargs=(1,)) as pool:
        return pool.submit(measured, *arguments).result()


def training(resolution: int, precision: Precision, more: int, repeats: int) -> dict[str, Any]:
    """Time of one step on one core."""
    batch = random_batch(resolution)
    step, peer = (step_seconds_apart(run, batch, precision, more, repeats) for run in (ours, plain))
    few = random_batch(WARM_UP), plan(WARM_UP, precision, 3)
    difference = abs(apart(ours, *few) / apart(plain, *few) - 1)
    hours = step * PAPER.epochs * PAPER_PAIRS / BATCH / 3600
    return row(
        f"training, {resolution} x {resolution}, {precision}, one step of {BATCH} images",
        step,
        peer="torch, float32, contiguous memory",
        peer_seconds=peer,
        target=f"at least {TIMES_FASTER} times faster, losses equal to {LARGEST_DIFFERENCE[precision]:.1%}",
        met=peer >= TIMES_FASTER * step and difference <= LARGEST_DIFFERENCE[precision],
        detail=f"{BATCH / step:.3g} images per second, losses of the third step at {WARM_UP} x {WARM_UP} differ by "
        f"{difference:.0e}; one core would take {hours:.3g} h for the paper's schedule, {PAPER.epochs} epochs of "
        f"{PAPER_PAIRS} images",
        images_per_second=BATCH / step,
        hours_of_the_papers_schedule=hours,
    )


def inference(resolution: int) -> dict[str, Any]:
    """Time of one prediction from depth image to depth image on one core."""
    image = person()
    contiguous = build(LITERAL).eval()
    network = build(LITERAL).to(memory_format=torch.channels_last).eval()
    small = torch.from_numpy(shrink(image, resolution)[:1])

    def peer() -> torch.Tensor:
        with torch.inference_mode():
            return contiguous(small[None])[0]

    seconds = least_seconds(lambda: enlarge(predict(network, torch.from_numpy(shrink(image, resolution)[:1]))), REPEATS)
    difference = float((peer() - predict(network, small)).abs().max())
    return row(
        f"prediction, {resolution} x {resolution}, one image",
        seconds,
        peer="torch, contiguous memory, the network alone",
        peer_seconds=least_seconds(peer, REPEATS),
        target=f"at most {MOST_SECONDS} s",
        met=seconds <= MOST_SECONDS and difference <= 1e-4,
        detail=f"from depth image to depth image of 500 x 500 pixels, float32, largest difference {difference:.0e}",
    )


def measure() -> list[dict[str, Any]]:
    """Time predictions and training steps on one core."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return [
            inference(128),
            inference(500),
            training(128, "bfloat16", more=4, repeats=REPEATS),
            training(128, "float32", more=4, repeats=REPEATS),
            training(500, "bfloat16", more=1, repeats=1),
        ]
    finally:
        torch.set_num_threads(threads)
