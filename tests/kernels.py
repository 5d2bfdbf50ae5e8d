"""The compiled kernels of the suite, and whether this process has come to use them."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

from numba.core.dispatcher import Dispatcher

PACKAGES = ("benchmark", "baselines", "learned", "retrieval")


def first_party_modules() -> list[ModuleType]:
    """All modules of the suite, imported."""
    modules = []
    for name in PACKAGES:
        package = importlib.import_module(name)
        names = [info.name for info in pkgutil.walk_packages(package.__path__, f"{name}.")]
        modules += [importlib.import_module(module) for module in names if not module.endswith("__main__")]
    return modules


def kernels_of(module: ModuleType) -> list[Dispatcher]:
    """The kernels that a module defines."""
    values = vars(module).values()
    return [value for value in values if isinstance(value, Dispatcher) and value.__module__ == module.__name__]


def was_compiled(kernel: Dispatcher) -> bool:
    """Whether a kernel was compiled in this process; one that is always inlined is part of those that call it."""
    return bool(kernel.signatures) or kernel.targetoptions.get("inline") == "always"
