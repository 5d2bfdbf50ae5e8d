"""Batches of fresh bodies, made ahead by other processes and delivered in order."""

from __future__ import annotations

import itertools
import pickle
from collections import deque
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from functools import cache, partial
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

import numpy as np
import torch

from benchmark.arrays import Arrays
from benchmark.errors import TrainingError, one_line
from benchmark.execution.processes.process import ForeignError, Process, ProcessEnded, Tell

AHEAD = 3
"""Batches in memory per worker process."""

MOST_LOSSES = 3
"""Number of times that worker processes may die over one batch."""


class Batch(Protocol):
    """Training data of one step."""

    @property
    def number(self) -> int:
        """Index in the stream."""
        ...

    @property
    def drawn_again(self) -> Mapping[str, int]:
        """Number of redraws, by reason."""
        ...


B = TypeVar("B", bound=Batch)


def batches(
    make: Callable[[int], B], numbers: range, workers: int, say: Callable[[str], None]
) -> Generator[B, None, None]:
    """Yield batches in the order of their numbers.

    A batch depends only on its number, so neither the number of worker processes nor their speed changes it. A process
    that dies is replaced, and its batch is made again.

    Parameters
    ----------
    make
        Maker of the batch of a number, always the same one; can be sent to another process.
    numbers
        Numbers of the batches.
    workers
        Number of worker processes; 0 makes each batch in this process, on request.
    say
        Called with a message for each process that dies.

    Raises
    ------
    TrainingError
        If a batch cannot be made; the message names it.
    """
    source = _ahead(make, numbers, workers, say) if workers else ((n, partial(make, n)) for n in numbers)
    with closing(source):
        for number, result in source:
            try:
                batch = result()
            except TrainingError:
                raise
            except Exception as error:
                raise _failed(number, error) from error
            yield batch


def _ahead(
    make: Callable[[int], B], numbers: range, workers: int, say: Callable[[str], None]
) -> Generator[tuple[int, Callable[[], B]], None, None]:
    """Yield numbers, each with a function that waits for its batch; one thread per worker process requests them."""
    idle: SimpleQueue[Process] = SimpleQueue()
    start = partial(Process, partial(_serve, make))

    def batch(number: int) -> B:
        losses = 0
        while True:
            process = idle.get()
            try:
                _, arrays = process.request({"number": number})
                batch: B = pickle.loads(arrays["batch"].tobytes())  # noqa: S301 - our own process made it
                return batch
            except ProcessEnded as error:
                losses += 1
                if losses > MOST_LOSSES:
                    raise _failed(number, "the processes that make it die; memory may not suffice") from error
                say(f"a process that makes bodies died by batch {number}; it is made again")
                process = start()
            finally:
                idle.put(process)

    pool, remaining = ThreadPoolExecutor(workers), iter(numbers)
    asked: deque[tuple[int, Future[B]]] = deque()
    try:
        for _ in range(workers):
            idle.put(start())
        while True:
            for number in itertools.islice(remaining, AHEAD * workers - len(asked)):
                asked.append((number, pool.submit(batch, number)))
            if not asked:
                return
            number, future = asked.popleft()
            yield number, future.result
    finally:
        pool.shutdown(cancel_futures=True)
        while not idle.empty():
            idle.get().end()


def _serve(
    make: Callable[[int], object], asked: Mapping[str, Any], arrays: Arrays, tell: Tell
) -> tuple[Mapping[str, Any], Arrays]:
    """Make the batch of a number, in a worker process."""
    _use_one_thread()
    return {}, {"batch": np.frombuffer(pickle.dumps(make(asked["number"]), pickle.HIGHEST_PROTOCOL), np.uint8)}


@cache
def _use_one_thread() -> None:
    from threadpoolctl import threadpool_limits

    torch.set_num_threads(1)
    threadpool_limits(1)


def _failed(number: int, error: object) -> TrainingError:
    reason = one_line(error) if isinstance(error, BaseException) and not isinstance(error, ForeignError) else str(error)
    return TrainingError(
        f"batch {number} cannot be made: {reason}", "correct it and train again: it goes on from the last checkpoint"
    )
