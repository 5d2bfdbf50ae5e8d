"""Messages between processes, one of which may run untrusted code: JSON and raw arrays, never objects."""

from __future__ import annotations

import json
import math
import select
import socket
import struct
import time
from collections.abc import Generator, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import LARGEST, Arrays

if TYPE_CHECKING:
    from _typeshed import HasFileno

Facts = Mapping[str, Any]

#: Facts and arrays.
Message = tuple[dict[str, Any], dict[str, NDArray[Any]]]


#: Maximum length of the JSON part of a message, in bytes.
LONGEST = 2**28

#: Length of the JSON that follows.
_HEAD = struct.Struct(">Q")


def wait_for(ends: Iterable[HasFileno], timeout: float | None, event: int = select.POLLIN) -> bool:
    """Wait until one of the channels is ready for an event; return whether one is."""
    poll = select.poll()
    for end in ends:
        poll.register(end, event)
    return bool(poll.poll(None if timeout is None else timeout * 1000))


class Channel:
    """One end of a private pipe; reading never blocks on an incomplete message.

    Arrays are copied, not shared: the sender could change or truncate shared memory while it is read here.

    Parameters
    ----------
    end
        A connected socket.
    patience
        Timeout in seconds if the other end accepts no data; None for no limit.
    """

    def __init__(self, end: socket.socket, patience: float | None = None) -> None:
        end.setblocking(False)
        self._socket = end
        self._patience = patience
        self._incoming = self._messages()
        self.fileno = end.fileno
        self.close = end.close

    def send(self, facts: Facts, arrays: Arrays | None = None) -> None:
        """Send a message.

        Raises
        ------
        ValueError, TypeError
            If the facts cannot be written as JSON, or an array holds objects; then nothing is sent.
        OSError
            If the other end is closed or accepts no data.
        """
        sent = {name: np.asanyarray(array) for name, array in (arrays or {}).items()}
        if any(array.dtype.hasobject for array in sent.values()):
            raise ValueError("an array of objects cannot be sent")
        kinds = [[name, array.dtype.str, array.shape, array.flags.fnc] for name, array in sent.items()]
        text = json.dumps([facts, kinds]).encode()
        if len(text) > LONGEST or sum(array.nbytes for array in sent.values()) > LARGEST:
            raise ValueError("the message is too large")
        self._send_bytes(_HEAD.pack(len(text)) + text)
        for array in sent.values():
            self._send_bytes(_bytes_of(array.T if array.flags.fnc else np.ascontiguousarray(array)))

    def receive(self, timeout: float | None = None) -> Message | None:
        """Return the next message; None if it does not arrive completely in time.

        Raises
        ------
        EOFError
            If the other end is closed.
        Exception
            Of any type, if the data is not a message: the sender is not trusted.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while (message := next(self._incoming)) is None:
            left = None if until is None else until - time.monotonic()
            if (left is not None and left < 0) or not wait_for([self], left):
                return None
        return message

    def _send_bytes(self, content: Any) -> None:
        left = memoryview(content)
        while left:
            try:
                left = left[self._socket.send(left) :]
            except BlockingIOError:
                if not wait_for([self], self._patience, select.POLLOUT):
                    raise TimeoutError from None

    def _messages(self) -> Iterator[Message | None]:
        """Yield messages as they arrive; None while the next one is incomplete."""
        while True:
            head = bytearray(_HEAD.size)
            yield from self._fill(head)
            (length,) = _HEAD.unpack(head)
            if length > LONGEST:
                raise ValueError("the message is too long")
            text = bytearray(length)
            yield from self._fill(text)
            facts, kinds = json.loads(text)
            arrays: dict[str, NDArray[Any]] = {}
            room = LARGEST
            for name, kind, shape, is_fortran in kinds:
                dtype = np.dtype(kind)
                room -= math.prod(shape) * dtype.itemsize
                if dtype.hasobject or not dtype.itemsize or room < 0:
                    raise ValueError("the arrays are too large, or hold objects")
                array = np.empty(shape[::-1] if is_fortran else shape, dtype)
                yield from self._fill(_bytes_of(array))
                arrays[str(name)] = array.T if is_fortran else array
            if not isinstance(facts, dict):
                raise TypeError("the facts of a message have no names")
            yield facts, arrays

    def _fill(self, buffer: Any) -> Generator[None, None, None]:
        left = memoryview(buffer)
        while left:
            try:
                count = self._socket.recv_into(left)
            except BlockingIOError:
                yield None
                continue
            if not count:
                raise EOFError
            left = left[count:]


def _bytes_of(array: NDArray[Any]) -> Any:
    return array.reshape(-1).view(np.uint8).data
