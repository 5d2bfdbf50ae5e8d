"""The paper's network beside plain torch: float32, contiguous memory. Weights and images do not matter to the time."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import torch

from learned.images import enlarge, shrink
from learned.paired.configuration import LITERAL
from learned.paired.model import predict
from learned.paired.network import build
from learned.paired.pairs import Pairs
from learned.paired.schedule import Schedule, losses
from learned.paired.training import train
from learned.training.loop import TrainingRun
from learned.training.machine import Precision, has_bfloat16
from tests.learned.toy import person
from tools.speed.timing import Row, least

BATCH, RESOLUTION, MORE_STEPS, REPEATS = 8, 128, 4, 3
PRECISION: Precision = "bfloat16" if has_bfloat16(torch.device("cpu")) else "float32"
PEER = "torch, float32, contiguous memory"


def measure() -> Iterator[Row]:
    """A prediction and a step of training on one core."""
    torch.set_num_threads(1)
    yield _prediction()
    # In new processes: our loop changes, for the whole of its process, how memory is allocated.
    new = multiprocessing.get_context("spawn")
    times = []
    for trained in (_ours, _plain):
        with ProcessPoolExecutor(1, mp_context=new, initializer=torch.set_num_threads, initargs=(1,)) as pool:
            times.append(pool.submit(_step_seconds, trained).result())
    detail = f"{PRECISION}, {RESOLUTION} x {RESOLUTION}, {BATCH / times[0]:.3g} images per second"
    yield Row(f"training, one step of {BATCH} images", times[0], detail, PEER, times[1])


def _prediction() -> Row:
    image = person()
    contiguous = build(LITERAL).eval()
    network = build(LITERAL).to(memory_format=torch.channels_last).eval()
    small = torch.from_numpy(shrink(image, RESOLUTION)[:1])

    def peer() -> torch.Tensor:
        with torch.inference_mode():
            return contiguous(small[None])[0]

    ours = least(lambda: enlarge(predict(network, torch.from_numpy(shrink(image, RESOLUTION)[:1]))), REPEATS)
    detail = f"from depth image to depth image of 500 x 500 pixels, by a network at {RESOLUTION} x {RESOLUTION}"
    return Row("prediction of one image", ours, detail, f"{PEER}, the network alone", least(peer, REPEATS))


def _batch() -> Pairs:
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(BATCH, 1, RESOLUTION, RESOLUTION, generator=generator)
    targets = torch.rand(BATCH, 2, RESOLUTION, RESOLUTION, generator=generator).round()
    return Pairs(tuple(map(str, range(BATCH))), images, targets, torch.arange(BATCH))


def _plan(steps: int) -> Schedule:
    """As many epochs as steps, for each has one batch."""
    return Schedule(resolution=RESOLUTION, epochs=steps, early_epochs=0, batch=BATCH, precision=PRECISION)


def _ours(batch: Pairs, schedule: Schedule) -> None:
    with tempfile.TemporaryDirectory() as folder:
        here = TrainingRun(folder=Path(folder), recipe={}, seed=0, device=torch.device("cpu"), say=lambda _: None)
        train(LITERAL, schedule, batch, None, here)


def _plain(batch: Pairs, schedule: Schedule) -> None:
    """The loop of a tutorial."""
    network = build(LITERAL)
    optimiser = torch.optim.Adam(network.parameters(), lr=schedule.learning_rate)
    for _ in range(schedule.epochs):
        optimiser.zero_grad()
        torch.stack(losses(network(batch.images), batch.targets, "all")).sum().backward()
        optimiser.step()


def _step_seconds(trained: Callable[[Pairs, Schedule], None]) -> float:
    """Time of one step: the difference between a training of one step and a longer one, over the steps of that."""
    batch = _batch()
    short, long = (least(partial(trained, batch, _plan(steps)), REPEATS) for steps in (1, 1 + MORE_STEPS))
    return (long - short) / MORE_STEPS
