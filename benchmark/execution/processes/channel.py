"""Messages between processes of which one may run foreign code: JSON and raw arrays, never objects."""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Generator, Iterable, Iterator, Mapping
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.arrays import LARGEST, Arrays

Facts = Mapping[str, Any]

#: Facts and arrays.
Message = tuple[dict[str, Any], dict[str, NDArray[Any]]]


class HasHandle(Protocol):
    """Something with a handle of the system."""

    def fileno(self) -> int:
        """Handle of the system."""
        ...


#: Bytes of the longest JSON of a message.
LONGEST = 2**28

#: Length of the JSON that follows.
_HEAD = struct.Struct(">Q")


def wait_for(ends: Iterable[HasHandle], timeout: float | None, event: int = select.POLLIN) -> bool:
    """Wait until one of some ends has something to receive, or takes something; returns whether one has."""
    poll = select.poll()
    for end in ends:
        poll.register(end.fileno(), event)
    return bool(poll.poll(None if timeout is None else timeout * 1000))


class Channel:
    """One end of a private pipe; half a message never holds whoever reads.

    Arrays are copied, not shared: whoever sent them could change or shorten a shared file while it is read here.

    Parameters
    ----------
    end
        A connected socket.
    patience
        Seconds that the other end may take no byte of what is sent to it; None for no limit.
    """

    def __init__(self, end: socket.socket, patience: float | None = None) -> None:
        end.setblocking(False)
        self._socket = end
        self._patience = patience
        self._incoming = self._messages()

    def fileno(self) -> int:
        """Handle that becomes ready when there is something to receive."""
        return self._socket.fileno()

    def send(self, facts: Facts, arrays: Arrays | None = None) -> None:
        """Send a message.

        Raises
        ------
        ValueError, TypeError
            If the facts do not fit into JSON, or an array holds objects; nothing was sent then.
        OSError
            If nobody takes it.
        """
        held = {name: np.asanyarray(array) for name, array in (arrays or {}).items()}
        if any(array.dtype.hasobject for array in held.values()):
            raise ValueError("an array of objects cannot be sent")
        kinds = [[name, array.dtype.str, array.shape, _order(array)] for name, array in held.items()]
        text = json.dumps([facts, kinds]).encode()
        if len(text) > LONGEST or sum(array.nbytes for array in held.values()) > LARGEST:
            raise ValueError("the message is too large")
        self._send_bytes(_HEAD.pack(len(text)) + text)
        for array in held.values():
            if array.nbytes:
                self._send_bytes(np.ravel(array, order=_order(array)).view(np.uint8).data)

    def receive(self, timeout: float | None = None) -> Message | None:
        """Return the next message; None if it is not there, as a whole, in time.

        Raises
        ------
        EOFError
            If there is nobody at the other end.
        Exception
            Of many kinds, if it is no message: whoever sent it may send anything.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while (message := next(self._incoming)) is None:
            left = None if until is None else until - time.monotonic()
            if (left is not None and left < 0) or not wait_for([self], left):
                return None
        return message

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def _send_bytes(self, content: Any) -> None:
        left = memoryview(content)
        while left:
            try:
                left = left[self._socket.send(left) :]
            except BlockingIOError:
                if not wait_for([self], self._patience, select.POLLOUT):
                    raise TimeoutError from None

    def _messages(self) -> Iterator[Message | None]:
        """Yield messages as they come; None where the next one is not there as a whole."""
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
            for name, kind, shape, order in kinds:
                dtype = np.dtype(kind)
                count = 1
                for size in shape:
                    if not isinstance(size, int) or size < 0:
                        raise ValueError("an array has no such shape")
                    count *= size
                room -= count * dtype.itemsize
                if dtype.hasobject or room < 0:
                    raise ValueError("the arrays are too large, or hold objects")
                raw = np.empty(count * dtype.itemsize, np.uint8)
                yield from self._fill(raw.data)
                arrays[str(name)] = np.ndarray(shape, dtype, raw.data, order=order)
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


def _order(array: NDArray[Any]) -> Literal["C", "F"]:
    return "F" if array.flags.fnc else "C"
