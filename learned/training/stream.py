"""Batches of fresh bodies, made ahead by other processes and handed out in their order, whoever made them."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection
from typing import Generic, Protocol, TypeVar

import torch

from benchmark.errors import TrainingError, one_line

AHEAD = 3
"""Batches in memory for each process that makes them."""

MOST_LOSSES = 3
"""How often in a row the processes may die over one batch."""


class Batch(Protocol):
    """Training data of one step."""

    @property
    def number(self) -> int:
        """Place in the stream."""
        ...

    @property
    def drawn_again(self) -> Mapping[str, int]:
        """Return how often something was drawn again, by reason."""
        ...


B = TypeVar("B", bound=Batch)


def batches(
    make: Callable[[int], B], numbers: range, workers: int, say: Callable[[str], None]
) -> Generator[B, None, None]:
    """Make batches in the order of their numbers.

    What a batch holds is a matter of its number, so neither how many processes there are nor which of them is the
    faster shows. A process that dies is replaced, and what it was at is made again.

    Parameters
    ----------
    make
        Makes the batch of a number, always the same one; can be sent to another process.
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
                yield make(number)
            except Exception as error:
                raise _failed(number, error) from error
        return
    yield from _Ahead(make, workers, say).batches(numbers)


class _Ahead(Generic[B]):
    """Processes, and what they were asked for."""

    def __init__(self, make: Callable[[int], B], workers: int, say: Callable[[str], None]) -> None:
        self._make = make
        self._workers = workers
        self._say = say
        self._asked: deque[tuple[int, Future[bytes]]] = deque()

    def batches(self, numbers: range) -> Iterator[B]:
        pool, losses = self._pool(), 0
        remaining: Iterator[int] = iter(numbers)
        try:
            while True:
                try:
                    while len(self._asked) < AHEAD * self._workers and (number := next(remaining, None)) is not None:
                        self._asked.append((number, Future()))
                        self._asked[-1] = (number, pool.submit(_packed, self._make, number))
                    if not self._asked:
                        return
                    batch: B = pickle.loads(self._asked[0][1].result())  # noqa: S301 - our own process made it
                except BrokenProcessPool as error:
                    losses += 1
                    number = self._asked[0][0]
                    if losses > MOST_LOSSES:
                        raise _failed(number, "the processes that make it die; memory may not suffice") from error
                    self._say(f"a process that makes bodies died by batch {number}; it is made again")
                    pool.shutdown(wait=False, cancel_futures=True)
                    pool = self._pool()
                    remaining = itertools.chain([number for number, _ in self._asked], remaining)
                    self._asked.clear()
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


def _packed(make: Callable[[int], object], number: int) -> bytes:
    """A batch as bytes; tensors would travel as shared memory, of which a container has little."""
    return pickle.dumps(make(number), protocol=pickle.HIGHEST_PROTOCOL)


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


def _failed(number: int, error: object) -> TrainingError:
    told = one_line(error) if isinstance(error, BaseException) else str(error)
    return TrainingError(
        f"batch {number} cannot be made: {told}", "correct it and train again: it goes on from the last checkpoint"
    )
