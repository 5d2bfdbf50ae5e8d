"""Batches of fresh bodies, made ahead by other processes and handed out in their order, whoever made them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import connection

import numpy as np
import torch
from torch import Tensor

from benchmark.errors import TrainingError, one_line
from benchmark.streaming import Fresh, MakesFresh
from learned.streamed.configuration import Streamed
from learned.streamed.crop import seen_by

AHEAD = 3
"""Batches in memory for each process that makes them."""

OVERSAMPLING = 2
"""Pixels rendered for each side of a pixel that the network sees."""

MOST_LOSSES = 3
"""How often in a row the processes may die over one batch."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Pairs to train on; the poses of one body are neighbours.

    Parameters
    ----------
    number
        Place in the stream.
    identifiers
        Names of the bodies.
    images
        Depth, shape (bodies * poses, 1, r, r).
    targets
        Depth of each side, then the mask, shape (bodies * poses, sides + 1, r, r).
    poses
        Poses of each body.
    drawn_again
        How often something was drawn again, by reason.
    """

    number: int
    identifiers: tuple[str, ...]
    images: Tensor
    targets: Tensor
    poses: int
    drawn_again: Mapping[str, int]


def batch_of(fresh: Fresh, number: int, configuration: Streamed) -> Batch:
    """Fresh bodies at the resolution of a network, without their frame if it does without."""
    poses = fresh.images.shape[1]
    images = [seen_by(configuration, image[None]) for of_body in fresh.images for image in of_body]
    targets = []
    for front, back in zip(fresh.fronts, fresh.backs, strict=True):
        sides = seen_by(configuration, np.stack([front, back][: configuration.sides]))
        targets.append(np.concatenate([sides, (sides[:1] > 0).astype(np.float32)]))
    repeated = torch.from_numpy(np.stack(targets)).repeat_interleave(poses, dim=0)
    return Batch(
        number, fresh.identifiers, torch.from_numpy(np.stack(images)), repeated, poses, dict(fresh.drawn_again)
    )


def batches(
    make: MakesFresh,
    configuration: Streamed,
    bodies: int,
    numbers: range,
    workers: int,
    say: Callable[[str], None],
) -> Iterator[Batch]:
    """Make batches in the order of their numbers.

    What a batch holds is a matter of its number, so neither how many processes there are nor which of them is the
    faster shows. A process that dies is replaced, and what it was at is made again.

    Parameters
    ----------
    make
        Makes fresh bodies.
    configuration
        What the network sees of them.
    bodies
        Bodies of each batch.
    numbers
        Which batches.
    workers
        Processes; 0 makes each batch here, when it is asked for.
    say
        Told about processes that died.

    Raises
    ------
    TrainingError
        If a batch cannot be made; the message names it.
    """
    if not workers:
        for number in numbers:
            try:
                yield _made(make, configuration, bodies, number)
            except Exception as error:
                raise _failed(number, error) from error
        return
    yield from _Ahead(make, configuration, bodies, workers, say).batches(numbers)


class _Ahead:
    """Processes, and what they were asked for."""

    def __init__(
        self, make: MakesFresh, configuration: Streamed, bodies: int, workers: int, say: Callable[[str], None]
    ) -> None:
        self._task = (make, configuration, bodies)
        self._workers = workers
        self._say = say
        self._asked: deque[tuple[int, Future[Batch]]] = deque()

    def batches(self, numbers: range) -> Iterator[Batch]:
        pool, losses = self._pool(), 0
        remaining = iter(numbers)
        try:
            while True:
                try:
                    while len(self._asked) < AHEAD * self._workers and (number := next(remaining, None)) is not None:
                        self._asked.append((number, Future()))
                        self._asked[-1] = (number, pool.submit(_made, *self._task, number))
                    if not self._asked:
                        return
                    batch = self._asked[0][1].result()
                except BrokenProcessPool as error:
                    losses += 1
                    number = self._asked[0][0]
                    if losses > MOST_LOSSES:
                        raise _failed(number, "the processes that make it die; memory may not suffice") from error
                    self._say(f"a process that makes bodies died by batch {number}; it is made again")
                    pool.shutdown(wait=False, cancel_futures=True)
                    pool = self._pool()
                    again = [number for number, _ in self._asked]
                    self._asked = deque((number, pool.submit(_made, *self._task, number)) for number in again)
                    continue
                except TrainingError:
                    raise
                except Exception as error:
                    raise _failed(self._asked[0][0], error) from error
                losses = 0
                self._asked.popleft()
                yield batch
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def _pool(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._workers, mp_context=context, initializer=_begin)


def _begin() -> None:
    """Set up a process: one thread, deaf to Ctrl-C, and gone when the training is, however that ends."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    threadpool_limits(1)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            connection.wait([parent.sentinel])
            os._exit(1)

        threading.Thread(target=watch, daemon=True).start()


def _made(make: MakesFresh, configuration: Streamed, bodies: int, number: int) -> Batch:
    return batch_of(make(number, bodies, OVERSAMPLING * configuration.resolution), number, configuration)


def _failed(number: int, error: object) -> TrainingError:
    told = one_line(error) if isinstance(error, BaseException) else str(error)
    return TrainingError(
        f"batch {number} cannot be made: {told}", "mend it and train again: it goes on from the last checkpoint"
    )
