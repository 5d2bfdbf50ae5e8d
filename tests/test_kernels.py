"""Compiled kernels go when their code or that of a module they use has changed."""

import os
import subprocess
import sys

import pytest

from benchmark.code_digest import ROOT
from benchmark.kernels import compiled_kernels, drop_stale_kernels, kernel_folder, suite_sources

KERNEL = (
    "from numba import njit\nfrom {origin} import {name}\n\n\n@njit(cache=True)\ndef kernel(x):\n    return {name}\n"
)

FILES = {
    "constants.py": "HALF = 0.5\n",
    "inner.py": KERNEL.format(origin="constants", name="HALF"),
    "outer.py": KERNEL.format(origin="inner", name="kernel"),
    "alone.py": KERNEL.format(origin="math", name="pi"),
}


@pytest.fixture
def sources(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    sources = [tmp_path / name for name in FILES]
    drop_stale_kernels(sources)
    for source in sources[1:]:
        for ending in ("nbi", "1.nbc"):
            (tmp_path / "__pycache__" / f"{source.stem}.kernel-6.py311.{ending}").write_text("")
    drop_stale_kernels(sources)
    assert all(len(compiled_kernels(source)) == 2 for source in sources[1:])
    return sources


@pytest.mark.parametrize(
    ("edited", "kept"),
    [
        ("constants.py", {"alone"}),
        ("inner.py", {"alone"}),
        ("outer.py", {"alone", "inner"}),
        ("alone.py", {"inner", "outer"}),
    ],
)
def test_what_was_compiled_from_other_code_goes(sources, edited, kept):
    path = sources[0].with_name(edited)
    path.write_text(path.read_text() + "MORE = 1\n")
    drop_stale_kernels(sources)
    assert {source.stem for source in sources if compiled_kernels(source)} == kept


def test_pytest_drops_stale_kernels_before_its_tests(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (source,) = (path for path in suite_sources() if path.name == "pose.py")
    folder = kernel_folder(source)
    folder.mkdir(parents=True)
    (folder / "pose.kernels").write_text("that of another code")
    (folder / "pose.kernel-1.py311.nbi").write_text("")
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only", "tests/test_text.py"]
    subprocess.run(words, cwd=ROOT, capture_output=True, check=False)
    assert compiled_kernels(source) == []


def test_kernels_stay_after_an_edit_of_a_docstring(sources):
    for source in sources:
        source.write_text(f'"""New words."""\n{source.read_text()}')
    drop_stale_kernels(sources)
    assert all(compiled_kernels(source) for source in sources[1:])


def test_older_kernels_without_a_mark_go_and_newer_ones_stay(sources):
    for source in sources:
        (source.parent / "__pycache__" / f"{source.stem}.kernels").unlink(missing_ok=True)
    os.utime(sources[0], (2**33, 2**33))
    drop_stale_kernels(sources)
    assert {source.stem for source in sources if compiled_kernels(source)} == {"alone"}


@pytest.mark.slow
def test_a_kernel_in_a_helper_of_a_plugin_is_compiled_again(tmp_path, monkeypatch):
    """numba would reuse the kernel of the plugin, into which that of the helper is compiled."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    helper = "from numba import njit\n\n\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
    outer = (
        "from numba import njit\nfrom helper import inner\n\n\n@njit(cache=True)\ndef outer(x):\n    return inner(x)\n"
    )
    (tmp_path / "outer.py").write_text(outer)
    path = str(tmp_path / "outer.py")
    program = f"from benchmark.registry.modules import load_module; print(load_module({path!r}).outer(1))"
    printed = []
    for value in (1, 20):  # of another length, so that Python compiles a file again that is written in the same second
        (tmp_path / "helper.py").write_text(helper.format(value))
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        printed.append(done.stdout.strip())
    assert printed == ["2", "21"]
