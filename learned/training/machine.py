"""Machine of a training, and which of the options that a user gives belong to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, TypeVar

from benchmark.api.contracts import Interval
from benchmark.parameters.values import checked
from benchmark.threads import available_cores
from learned.training.arithmetic import device_named


@dataclass(frozen=True, kw_only=True)
class Machine:
    """Machine of a training, which is no part of what determines the model.

    Parameters
    ----------
    device
        ``"auto"`` takes a GPU where there is one.
    threads
        Threads on the CPU; None takes all cores of this process that do nothing else.
    """

    device: Literal["auto", "cpu", "cuda"] = "auto"
    threads: Annotated[int, Interval(1)] | None = None

    @property
    def cores(self) -> int:
        """Threads to compute with on the CPU."""
        return self.threads or available_cores()


M = TypeVar("M", bound=Machine)


def machine_among(kind: type[M], options: Mapping[str, Any]) -> tuple[M, dict[str, Any]]:
    """Machine that some of the options describe, and the other options.

    Parameters
    ----------
    kind
        Machine or a kind of it; its fields are the names of its options.
    options
        As the user gave them.

    Raises
    ------
    ConfigurationError
        If an option does not fit, or there is no such device here.
    """
    names = {field.name for field in fields(kind)}
    own = {name: value for name, value in options.items() if name in names}
    machine = kind(**checked(kind, own, "the training"))
    device_named(machine.device)
    return machine, {name: value for name, value in options.items() if name not in names}
