"""The compiled kernels of the suite."""

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
