"""Plugin files are imported like modules; what goes wrong is named with file and line."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.registry.known import in_file
from benchmark.registry.modules import environment, load_module
from tests.registry.plugin import write_plugin


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if "plugin_" in name or "helper" in name:
            del sys.modules[name]


@pytest.mark.parametrize(
    ("imports", "message"),
    [
        (
            "1 / 0",
            r"smooth.py cannot be imported: smooth.py:8: ZeroDivisionError: division by zero; "
            r"correct it$",
        ),
        (
            "import missing_here",
            "smooth.py:8: ModuleNotFoundError: .*; install 'missing_here', or put missing_here.py",
        ),
        (
            "MethodInfo(name='A', title='B')",
            r"imported: smooth.py:8: .A. does not fit name of MethodInfo; "
            r"write lower-case words joined by hyphens$",
        ),
        ("raise SystemExit(3)", r"smooth.py:8: SystemExit: 3"),
        (
            "import helper",
            r"smooth.py cannot be imported: helper.py:2: NameError: name 'x' is not defined",
        ),
    ],
)
def test_an_error_of_an_import_names_file_and_line(tmp_path, imports, message):
    (tmp_path / "helper.py").write_text("\nx\n")
    with pytest.raises(ConfigurationError, match=message):
        load_module(str(write_plugin(tmp_path / "smooth.py", imports=imports)))


def test_compiled_code_of_the_suite_outlives_the_import_of_a_plugin(tmp_path, monkeypatch):
    removed = []
    monkeypatch.setattr("benchmark.registry.modules.remove_kernels", removed.extend)
    path = write_plugin(
        tmp_path / "smooth.py", imports="from benchmark.geometry.geodesics import all_pairs"
    )
    load_module(str(path))
    assert removed == [path]


def test_a_thread_waits_for_a_module_that_another_one_imports(tmp_path, monkeypatch):
    (tmp_path / "slowly_imported.py").write_text("import time; time.sleep(0.3); Late = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    plugin = write_plugin(tmp_path / "slow.py", imports="import time; time.sleep(0.3)")
    before = sys.stdout
    with ThreadPoolExecutor(8) as threads:
        late = threads.map(lambda _: load_module("slowly_imported:Late").Late, range(4))
        own = threads.map(lambda _: load_module(str(plugin)).Smooth, range(4))
        assert {*late} == {1}
        assert len({*own}) == 1
    assert sys.stdout is before


def test_a_plugin_that_adds_folders_to_the_path_of_modules_is_imported_once(tmp_path):
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "helper_elsewhere.py").write_text("VALUE = 1\n")
    (tmp_path / "helper_beside.py").write_text("VALUE = 2\n")
    imports = f"import sys\nsys.path.append({str(tmp_path / 'library')!r})\n"
    imports += "import helper_beside\nimport helper_elsewhere"
    path = write_plugin(tmp_path / "smooth.py", imports=imports)
    module = load_module(str(path))
    assert load_module(str(path)) is module
    (tmp_path / "library" / "helper_elsewhere.py").write_text("VALUE = 30\n")
    assert load_module(str(path)).helper_elsewhere.VALUE == 30


def test_a_plugin_called_random_does_not_replace_the_standard_module(tmp_path):
    path = write_plugin(tmp_path / "random.py", imports="import random")
    module = load_module(str(path))
    assert module.random is random
    assert sys.modules["random"] is random


def test_two_plugins_with_helpers_of_one_name_are_refused(tmp_path):
    paths = [
        write_plugin(tmp_path / name / "smooth.py", imports="import helper_of_two") for name in "ab"
    ]
    for path in paths:
        path.with_name("helper_of_two.py").write_text(f"WHERE = {path.parent.name!r}\n")
    assert load_module(str(paths[0])).helper_of_two.WHERE == "a"
    with pytest.raises(
        ConfigurationError,
        match=r"b/helper_of_two.py, but 'helper_of_two' is also the name of .*a/",
    ):
        load_module(str(paths[1]))


def test_a_helper_with_the_name_of_a_package_is_refused(tmp_path):
    (tmp_path / "numpy.py").write_text("")
    with pytest.raises(
        ConfigurationError, match=r"numpy.py, but 'numpy' is also the name of .*; rename one"
    ):
        load_module(str(write_plugin(tmp_path / "smooth.py", imports="import numpy")))


def test_a_file_without_a_plugin_is_refused(tmp_path):
    (tmp_path / "empty.py").write_text("from benchmark.api import MethodInfo\n")
    with pytest.raises(ConfigurationError, match="defines no method and no scorer"):
        in_file(tmp_path / "empty.py")


def test_a_data_set_is_no_plugin(tmp_path):
    made = (
        "from benchmark.datasets.mesh_files import mesh_file_set\n"
        "RODS = mesh_file_set(name='rods', shapes=())\n"
    )
    (tmp_path / "rods.py").write_text(made)
    with pytest.raises(
        ConfigurationError, match=r"rods.py .*; write a folder, .*: python bent_ellipsoids.py DIR$"
    ):
        in_file(tmp_path / "rods.py")


def test_prints_of_a_plugin_go_to_stderr(tmp_path):
    path = write_plugin(tmp_path / "smooth.py", imports="print('imported')")
    program = f"from benchmark.registry.modules import load_module; load_module({str(path)!r})"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert (done.stdout, done.stderr) == ("", "imported\n")


def test_a_package_of_another_folder_than_pythons_is_no_code_of_the_user(tmp_path):
    packages = tmp_path / "packages"  # as on a cluster, or after pip install --user
    for folder, file, text in (
        ("lib", "__init__.py", "from . import inner"),
        ("lib", "inner.py", ""),
        ("lib-1.dist-info", "RECORD", "lib/,,"),
        ("lib-1.dist-info", "METADATA", "Metadata-Version: 2.1\nName: lib\nVersion: 1\n"),
    ):
        (packages / folder).mkdir(parents=True, exist_ok=True)
        (packages / folder / file).write_text(text)
    odd = tmp_path / "dist-packages"  # of a system, with a module that bears the name of no package
    (odd / "lib").mkdir(parents=True)
    (odd / "lib" / "_utility.py").write_text("")
    path = write_plugin(
        tmp_path / "smooth.py", imports="import lib; __import__('lib._utility'[4:])"
    )
    program = "from benchmark.reads import watch_this_process; watch_this_process(); "
    program += f"from benchmark.registry.modules import load_module; load_module({str(path)!r})"
    found = os.pathsep.join([str(packages), str(odd / "lib"), os.environ["PYTHONPATH"]])
    subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": found}, check=True
    )


def test_a_relative_import_says_what_to_write(tmp_path):
    (tmp_path / "core.py").write_text("X = 1\n")
    for line in ("from .core import X", "from . import core", "from ..pack import X"):
        (tmp_path / "plug.py").write_text(f"{line}\n")
        with pytest.raises(ConfigurationError, match="write 'from core import X'"):
            load_module(str(tmp_path / "plug.py"))


@pytest.mark.parametrize("target", ["method.txt", "/proc/self/pagemap"])
def test_a_link_to_what_is_no_python_file_is_no_plugin(target, tmp_path):
    (tmp_path / "method.txt").write_text("")
    (tmp_path / "method.py").symlink_to(target)
    with pytest.raises(ConfigurationError, match=r"method.py is a link to .*, which is no Python"):
        in_file(tmp_path / "method.py")


def test_what_a_plugin_sets_before_its_import_fails_reaches_no_other_process(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.registry.modules._changed", {})
    monkeypatch.setenv("OF_USER", "before")
    text = "import os\nos.environ['OF_USER'] = 'after'\n1 / 0"
    with pytest.raises(ConfigurationError, match="division by zero"):
        load_module(str(write_plugin(tmp_path / "smooth.py", imports=text)))
    assert environment()["OF_USER"] == "before"


def test_a_class_with_two_names_is_one_method(tmp_path):
    path = write_plugin(tmp_path / "smooth.py")
    path.write_text(path.read_text() + "\n\nOldName = Smooth\n")
    (component,) = in_file(path)
    assert component.target.endswith(":Smooth")


def test_what_a_plugin_changes_of_the_process_is_put_back_after_its_import(tmp_path):
    folder = Path.cwd()
    imports = "import os\nos.umask(0o777)\nos.chdir('/')"
    module = load_module(str(write_plugin(tmp_path / "smooth.py", imports=imports)))
    umask = os.umask(0o022)
    os.umask(umask)
    assert module.os is os
    assert umask != 0o777
    assert Path.cwd() == folder


def test_a_copy_of_the_process_that_an_import_forks_goes_no_further(tmp_path):
    program = """
import sys
from benchmark.registry.modules import load_module
load_module(sys.argv[1])
print("imported", flush=True)
"""
    imports = "import os\ncopy = os.fork()\nif copy:\n    os.waitpid(copy, 0)"
    plugin = write_plugin(tmp_path / "smooth.py", imports=imports)
    command = [sys.executable, "-c", program, plugin]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "imported\n"
    assert "a process that was forked did not end" in done.stderr
