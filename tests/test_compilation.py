"""``python -m benchmark.kernel_cache`` leaves no kernel for a run to compile."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import pytest
from numba.core.dispatcher import Dispatcher

from benchmark.code_digest import FIRST_PARTY
from benchmark.kernel_cache.__main__ import main


def kernels() -> list[Dispatcher]:
    """All kernels of the suite."""
    found = []
    for package in map(importlib.import_module, FIRST_PARTY):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not info.name.endswith("__main__"):
                values = vars(importlib.import_module(info.name)).values()
                found += [
                    each
                    for each in values
                    if isinstance(each, Dispatcher) and each.__module__ == info.name
                ]
    return found


def print_what_is_left(*, quick: bool) -> None:
    """Print the kernels that are neither called nor compiled into one that is, and those that are
    not kept.
    """
    main(["--quick"] if quick else [])
    ready = [kernel for kernel in kernels() if kernel.signatures]
    for kernel in ready:  # which grows
        used = map(kernel.py_func.__globals__.get, kernel.py_func.__code__.co_names)
        ready += [inner for inner in used if isinstance(inner, Dispatcher) and inner not in ready]
    for kernel in kernels():
        is_kept = kernel.stats.cache_path or kernel.targetoptions.get("inline") == "always"
        if kernel not in ready or not is_kept:
            print(f"{kernel.__module__}.{kernel.__name__}")


def test_a_word_that_means_nothing_is_no_success(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["gsp"])
    assert ended.value.code == 2
    assert "error: unknown step with kernels 'gsp'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quick", "modules"), [(False, set()), (True, {"benchmark.datasets.scanning"})]
)
def test_every_kernel_is_compiled_ahead(quick, modules):
    """In a process that has called none before; a quick run shows no scan."""
    program = f"from {__name__} import print_what_is_left; print_what_is_left(quick={quick})"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=1700, check=False
    )
    assert done.returncode == 0, done.stderr
    assert {line.rpartition(".")[0] for line in done.stdout.splitlines()} <= modules
    assert len(kernels()) > 40
