"""Compiled kernels go when their code or that of a module they use has changed."""

import os
import subprocess
import sys
import time

import pytest

from benchmark import code_digest, kernel_cache
from benchmark.kernel_cache import compiled_kernels, drop_stale_kernels, is_marked, mark

KERNEL = (
    "from numba import njit\nfrom {origin} import {name}\n\n\n"
    "@njit(cache=True)\ndef kernel(x):\n    return {name}\n"
)

FILES = {
    "constants.py": "HALF = 0.5\n",
    "inner.py": KERNEL.format(origin="constants", name="HALF"),
    "outer.py": KERNEL.format(origin="inner", name="kernel"),
    "alone.py": KERNEL.format(origin="math", name="pi"),
}


@pytest.mark.parametrize(
    ("edited", "kept"),
    [
        ("constants.py", {"alone"}),
        ("inner.py", {"alone"}),
        ("outer.py", {"alone", "inner"}),
        ("alone.py", {"inner", "outer"}),
    ],
)
def test_what_was_compiled_from_other_code_goes(tmp_path, monkeypatch, edited, kept):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    sources = [tmp_path / name for name in FILES]
    monkeypatch.setattr(kernel_cache, "suite_sources", lambda: sources)
    for module in (kernel_cache, code_digest):
        monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(code_digest, "FIRST_PARTY", [source.stem for source in sources])
    monkeypatch.setattr(
        code_digest, "_locate_once", lambda parts: code_digest._find(tmp_path, parts)
    )
    (tmp_path / "__pycache__").mkdir()
    for source in sources[1:]:
        for ending in ("nbi", "1.nbc"):
            (tmp_path / "__pycache__" / f"{source.stem}.kernel-6.py311.{ending}").write_text("")
        mark("step", source)
    drop_stale_kernels()
    assert all(len(compiled_kernels(source)) == 3 for source in sources[1:])
    assert all(is_marked("step", source) for source in sources[1:])
    path = tmp_path / edited
    time.sleep(0.02)  # the clock of a file system may be late
    path.write_text(path.read_text() + "MORE = 1\n")
    os.utime(path, (0, 0))  # an older file that was put in its place
    drop_stale_kernels()
    assert {source.stem for source in sources if compiled_kernels(source)} == kept
    assert {source.stem for source in sources if is_marked("step", source)} == kept


@pytest.mark.slow
def test_kernels_of_a_plugin_are_compiled_anew_in_each_process(tmp_path, monkeypatch):
    """numba would reuse the kernel of the plugin, into which that of the helper and a value of a
    file are compiled.
    """
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    kernel = "from numba import njit\n{}\n\n@njit(cache=True)\ndef {}(x):\n    return {}\n"
    path = tmp_path / "outer.py"
    path.write_text(
        kernel.format(
            "from helper import inner\nVALUE = float(open('k.txt').read())",
            "outer",
            "inner(x) + VALUE",
        )
    )
    program = (
        "from benchmark.registry.modules import load_module; "
        f"print(load_module({str(path)!r}).outer(1))"
    )
    printed = []
    for value, constant in ((1, 0), (20, 0), (20, 300)):
        (tmp_path / "helper.py").write_text(kernel.format("", "inner", f"x + {value}"))
        (tmp_path / "k.txt").write_text(str(constant))
        command = [sys.executable, "-c", program]
        printed.append(
            subprocess.run(
                command, capture_output=True, text=True, check=True, cwd=tmp_path
            ).stdout.strip()
        )
    assert printed == ["2.0", "21.0", "321.0"]


def test_the_link_of_an_editor_beside_an_unsaved_file_is_no_source(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "ROOT", tmp_path)
    monkeypatch.setattr(kernel_cache, "FIRST_PARTY", ["package"])
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "inner.py").write_text("")
    (tmp_path / "package" / ".#inner.py").symlink_to("user@machine.1234")
    drop_stale_kernels()
    assert kernel_cache.suite_sources() == [tmp_path / "package" / "inner.py"]


def test_kernels_that_another_python_compiled_are_not_compiled_for_this_one(tmp_path, monkeypatch):
    mark("step", tmp_path / "inner.py")
    assert is_marked("step", tmp_path / "inner.py")
    monkeypatch.setattr(sys.implementation, "cache_tag", "cpython-399")
    assert not is_marked("step", tmp_path / "inner.py")
