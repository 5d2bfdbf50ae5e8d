"""Devices, precision and memory of a training."""

from __future__ import annotations

import ctypes
import sys
from typing import Literal

import torch

from benchmark.errors import ConfigurationError

Precision = Literal["auto", "float32", "bfloat16"]

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4
"""Parameters of ``mallopt``; see its manual page."""


def device_named(name: Literal["auto", "cpu", "cuda"]) -> torch.device:
    """Device of this name; ``"auto"`` takes a GPU where there is one.

    Raises
    ------
    ConfigurationError
        If there is no such device here.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigurationError("no GPU is here, or this torch cannot use it", "pass --device cpu or auto")
    return torch.device("cuda" if name != "cpu" and torch.cuda.is_available() else "cpu")


def has_bfloat16(device: torch.device) -> bool:
    """Return whether the hardware multiplies bfloat16 by itself; software emulation would be slower than float32."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    return torch.backends.mkldnn.is_available() and bool(torch.ops.mkldnn._is_mkldnn_bf16_supported())


def keep_freed_memory() -> None:
    """Let the C library of Linux keep the memory of freed tensors for the next ones.

    Otherwise it returns large ones to the system, and every step asks for them again, page by page: up to a quarter of
    its time.
    """
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_MMAP_MAX, 0)
        library.mallopt(_TRIM_THRESHOLD, -1)
