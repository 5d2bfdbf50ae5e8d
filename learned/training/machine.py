"""Machine of a training: device, precision, memory, and the options that belong to it."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, TypeVar

import torch

from benchmark.api.contracts import Interval
from benchmark.api.parameters import checked
from benchmark.errors import ConfigurationError
from benchmark.machine import available_cores

Precision = Literal["auto", "float32", "bfloat16"]

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4
"""Parameters of ``mallopt``; see its manual page."""


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Machine of a training, which is not part of the recipe of the model.

    Parameters
    ----------
    device
        ``"auto"`` takes a GPU if there is one.
    threads
        Threads on the CPU; None takes all cores of this process that do not make bodies.
    """

    device: Literal["auto", "cpu", "cuda"] = "auto"
    threads: Annotated[int, Interval(1)] | None = None

    @property
    def cores(self) -> int:
        """Number of threads on the CPU."""
        return self.threads or max(1, available_cores() - self.workers)

    @property
    def workers(self) -> int:
        """Number of processes that make batches."""
        return 0


@dataclass(frozen=True, kw_only=True)
class MachineWithWorkers(Machine):
    """A machine on which worker processes make bodies.

    Parameters
    ----------
    workers
        Number of worker processes; 0 makes the bodies between the steps.
    """

    workers: Annotated[int, Interval(0, 64)] = 1


M = TypeVar("M", bound=Machine)


def machine_among(kind: type[M], options: Mapping[str, Any]) -> tuple[M, dict[str, Any]]:
    """Return the machine that some of the options describe, and the other options.

    Parameters
    ----------
    kind
        ``Machine`` or a subclass; its fields are the names of its options.
    options
        Options as given by the user.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or the device is not available.
    """
    names = {field.name for field in fields(kind)}
    own = {name: value for name, value in options.items() if name in names}
    machine = kind(**checked(kind, own, "the training"))
    device_named(machine.device)
    return machine, {name: value for name, value in options.items() if name not in names}


def device_named(name: Literal["auto", "cpu", "cuda"]) -> torch.device:
    """Return the device of this name; ``"auto"`` takes a GPU if there is one.

    Raises
    ------
    ConfigurationError
        If the device is not available.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigurationError("no GPU is here, or this torch cannot use it", "pass --device cpu or auto")
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


def has_bfloat16(device: torch.device) -> bool:
    """Return whether the hardware multiplies bfloat16 natively; emulation in software would be slower than float32."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    return torch.backends.mkldnn.is_available() and bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


def keep_freed_memory() -> None:
    """Make the C library of Linux keep the memory of freed tensors for the next ones.

    Otherwise it returns large blocks to the system, and every step requests them again, page by page, which takes up to
    a quarter of its time.
    """
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_MMAP_MAX, 0)
        library.mallopt(_TRIM_THRESHOLD, -1)


def is_out_of_memory(error: Exception) -> bool:
    """Return whether an error of torch reports a failed allocation."""
    if isinstance(error, (torch.OutOfMemoryError, MemoryError)):
        return True
    return isinstance(error, RuntimeError) and any(text in str(error) for text in ("allocate memory", "out of memory"))
