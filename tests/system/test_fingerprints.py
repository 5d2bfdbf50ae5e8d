"""What a fingerprint of code and packages changes with, and what it does not."""

import importlib.metadata
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmark.storage import keys
from benchmark.system import fingerprints

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def fresh():
    fingerprints.clear_cache()
    yield
    fingerprints.clear_cache()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A first-party package: method -> helper and, in train alone, trainer -> pictures; and a bystander."""
    root = tmp_path / "toyparty"
    root.mkdir()
    (root / "__init__.py").write_text("")
    (root / "method.py").write_text(
        '"""Method."""\n\n\ndef run(x):\n    from toyparty import helper\n\n    return helper.twice(x)\n\n\n'
        "def train(x):\n    from toyparty import trainer\n\n    return trainer.fit(x)\n"
    )
    (root / "helper.py").write_text("from . import constants\n\n\ndef twice(x):\n    return constants.TWO * x\n")
    (root / "constants.py").write_text("TWO = 2\n")
    (root / "trainer.py").write_text("from .pictures import draw\n\n\ndef fit(x):\n    return draw(x)\n")
    (root / "pictures.py").write_text("def draw(x):\n    return x\n")
    (root / "bystander.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(fingerprints, "FIRST_PARTY", (*fingerprints.FIRST_PARTY, "toyparty"))
    return root


def changes(path, text, *names, **options):
    """Whether a file with another text changes a fingerprint."""
    fingerprints.clear_cache()
    before = fingerprints.fingerprint(*names, **options)
    path.write_text(text)
    fingerprints.clear_cache()
    return before != fingerprints.fingerprint(*names, **options)


def test_an_edit_in_a_helper_invalidates(package):
    assert changes(package / "helper.py", "def twice(x):\n    return 3 * x\n", "toyparty.method")


def test_a_function_that_is_left_out_may_change(package):
    text = (package / "method.py").read_text()
    edited = text.replace("trainer.fit(x)", "trainer.fit(x + 1)")
    assert not changes(package / "method.py", edited, "toyparty.method", without=("train",))
    assert changes(package / "method.py", text, "toyparty.method")


def test_relative_imports_are_followed(package):
    assert set(fingerprints.fingerprint("toyparty.method").code) == {
        "toyparty", "toyparty.method", "toyparty.helper", "toyparty.constants", "toyparty.trainer", "toyparty.pictures",
    }  # fmt: skip
    assert changes(package / "constants.py", "TWO = 3\n", "toyparty.method")


@pytest.mark.parametrize(
    "line",
    [
        "from .constants import TWO",
        "from . import constants",
        "from .inner import deep",
        "from .inner.deep import VALUE",
        "import toyparty.inner.deep",
        "from toyparty.inner import *",
    ],
)
def test_every_way_to_import_is_seen(package, line):
    (package / "inner").mkdir()
    (package / "inner" / "__init__.py").write_text("from .deep import VALUE\n")
    (package / "inner" / "deep.py").write_text("from ..constants import TWO\nVALUE = TWO\n")
    (package / "method.py").write_text(f"{line}\n")
    assert "toyparty.constants" in fingerprints.fingerprint("toyparty.method").code


def test_what_is_imported_for_type_checking_alone_is_left_out_and_the_other_branch_is_not(package):
    (package / "method.py").write_text(
        "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    from toyparty import bystander\n"
        "else:\n    from toyparty import helper\n"
    )
    assert set(fingerprints.fingerprint("toyparty.method").code) == {
        "toyparty", "toyparty.method", "toyparty.helper", "toyparty.constants",
    }  # fmt: skip
    (package / "method.py").write_text(
        "import typing\n\nif not typing.TYPE_CHECKING:\n    from toyparty import helper\n"
    )
    fingerprints.clear_cache()
    assert "toyparty.helper" in fingerprints.fingerprint("toyparty.method").code


def test_comments_docstrings_and_moved_lines_do_not_invalidate(package):
    path = package / "method.py"
    text = path.read_text().replace("Method.", "Other words.\n").replace("\n\n\n", "\n\n# why\n\n\n")
    assert not changes(path, text.replace("def run(x):", 'def run(x):\n    """Say more."""'), "toyparty.method")


def test_a_literal_and_an_operator_do_invalidate(package):
    path = package / "pictures.py"
    for text in ("def draw(x):\n    return None\n", "def draw(x):\n    return -x\n", "def draw(x):\n    return +x\n"):
        assert changes(path, text, "toyparty.method")


def test_an_edit_elsewhere_does_not_invalidate(package):
    assert not changes(package / "bystander.py", "x = 2\n", "toyparty.method")


def test_imports_of_a_function_that_a_stage_never_calls_are_left_out(package):
    text = "def draw(x):\n    return 2 * x\n"
    assert changes(package / "pictures.py", text, "toyparty.method")
    (package / "pictures.py").write_text("def draw(x):\n    return x\n")
    assert not changes(package / "pictures.py", text, "toyparty.method", without=("train",))
    assert changes(package / "helper.py", "def twice(x):\n    return x\n", "toyparty.method", without=("train",))


def test_what_only_training_needs_is_no_part_of_the_forms_of_a_learner():
    forms = fingerprints.fingerprint("learned.paired.methods", without=("train", "check_options")).code
    assert {"learned.paired.methods", "learned.paired.model", "learned.paired.network", "learned.images"} <= set(forms)
    assert not {
        "learned.paired.pictures",
        "learned.paired.fitting",
        "learned.paired.training",
        "learned.paired.pairs",
    } & set(forms)
    assert "learned.paired.pictures" in fingerprints.fingerprint("learned.paired.methods").code


def test_an_edit_in_the_pictures_of_a_training_leaves_forms_alone(tmp_path):
    """The same on a copy of the real package, by an edit."""
    from shutil import copytree, ignore_patterns

    for name in fingerprints.FIRST_PARTY:
        copytree(ROOT / name, tmp_path / name, ignore=ignore_patterns("__pycache__", "models", "*.npz"))

    def prints():
        command = (
            "from benchmark.system import fingerprints\n"
            "print(fingerprints.fingerprint('learned.paired.methods', without=('train', 'check_options')).digest)\n"
            "print(fingerprints.fingerprint('learned.paired.methods').digest)"
        )
        done = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, check=True, cwd=tmp_path, env=clean()
        )
        return done.stdout.split()

    forms, all_code = prints()
    path = tmp_path / "learned" / "paired" / "pictures.py"
    path.write_text(path.read_text().replace("COLUMNS = 10", "COLUMNS = 11"))
    assert (tmp_path / "learned" / "paired" / "pictures.py").read_text().count("COLUMNS = 11") == 1
    forms_then, all_then = prints()
    assert forms_then == forms
    assert all_then != all_code


def clean():
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def test_the_closure_names_what_is_imported_inside_functions():
    assert {"benchmark.api.contracts", "benchmark.geometry.geodesics"} <= set(
        fingerprints.fingerprint("baselines.classic_mds").code
    )


def test_modules_that_cannot_change_a_result_are_left_out_with_what_they_import(package, monkeypatch):
    assert not fingerprints.IGNORED & set(fingerprints.fingerprint("baselines.classic_mds").code)
    monkeypatch.setattr(fingerprints, "IGNORED", fingerprints.IGNORED | {"toyparty.helper"})
    assert set(fingerprints.fingerprint("toyparty.method", without=("train",)).code) == {"toyparty", "toyparty.method"}


# Plugins -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def plugin(tmp_path):
    """A plugin file with a helper beside it, and a neighbour that it does not import."""
    (tmp_path / "plugins").mkdir()
    path = tmp_path / "plugins" / "mine.py"
    path.write_text("import numpy\n\nfrom side_helper import twice\n\n\ndef run(x):\n    return twice(x)\n")
    (path.parent / "side_helper.py").write_text("def twice(x):\n    return 2 * x\n")
    (path.parent / "neighbour.py").write_text("x = 1\n")
    return path


def test_a_helper_beside_a_plugin_belongs_to_it(plugin):
    assert set(fingerprints.fingerprint(str(plugin)).code) == {"mine.py", "side_helper"}
    assert changes(plugin.with_name("side_helper.py"), "def twice(x):\n    return 3 * x\n", str(plugin))
    assert not changes(plugin.with_name("neighbour.py"), "x = 2\n", str(plugin))


def test_a_helper_package_beside_a_plugin_belongs_to_it_in_all_its_modules(plugin):
    package = plugin.with_name("side_package")
    package.mkdir()
    (package / "__init__.py").write_text("from .parts import half\n")
    (package / "parts.py").write_text("def half(x):\n    return x / 2\n")
    plugin.write_text("from side_package import half\n")
    assert set(fingerprints.fingerprint(str(plugin)).code) == {"mine.py", "side_package", "side_package.parts"}
    assert changes(package / "parts.py", "def half(x):\n    return x / 4\n", str(plugin))


def test_a_helper_on_the_search_path_belongs_to_its_plugin(plugin, tmp_path, monkeypatch):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "far_helper.py").write_text("def thrice(x):\n    return 3 * x\n")
    (folder / "far_bystander.py").write_text("x = 1\n")
    plugin.write_text("from far_helper import thrice\n")
    monkeypatch.syspath_prepend(folder)  # what PYTHONPATH does
    assert set(fingerprints.fingerprint(str(plugin)).code) == {"mine.py", "far_helper"}
    assert changes(folder / "far_helper.py", "def thrice(x):\n    return 4 * x\n", str(plugin))
    assert not changes(folder / "far_bystander.py", "x = 2\n", str(plugin))


def test_the_place_of_a_plugin_does_not_matter(tmp_path):
    found = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "plugin.py").write_text("import beside_plugin\nvalue = 1\n")
        (tmp_path / folder / "beside_plugin.py").write_text("value = 2\n")
        found.append(fingerprints.fingerprint(str(tmp_path / folder / "plugin.py")).digest)
    assert found[0] == found[1]


# Packages ------------------------------------------------------------------------------------------------------------


def test_versions_of_imported_packages_are_in_the_fingerprint_and_no_others(monkeypatch):
    found = fingerprints.fingerprint("benchmark.geometry.geodesics")
    assert found.packages["numpy"] == importlib.metadata.version("numpy")
    assert found.packages["libigl"] == importlib.metadata.version("libigl")  # imported as igl
    assert "torch" not in found.packages
    assert "torch" in fingerprints.fingerprint("learned.paired.methods").packages


def test_another_version_of_a_package_is_another_recipe(monkeypatch):
    before = fingerprints.fingerprint("benchmark.geometry.geodesics", "retrieval.cmbof")
    real = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "9.9" if name == "libigl" else real(name))
    fingerprints.clear_cache()
    fingerprints._versions.cache_clear()
    after = fingerprints.fingerprint("benchmark.geometry.geodesics", "retrieval.cmbof")
    fingerprints._versions.cache_clear()
    assert after.digest != before.digest
    assert after.code == before.code
    assert dict(after.packages) == {**before.packages, "libigl": "9.9"}


def install(folder, name, *files, url=""):
    """Lay a distribution of version 1.2 into a folder, as installers do; ``url`` is where its sources are edited."""
    told = folder / f"{name}-1.2.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    (told / "RECORD").write_text("".join(f"{file},,\n" for file in files))
    if url:
        (told / "direct_url.json").write_text(json.dumps({"url": url, "dir_info": {"editable": True}}))


def test_what_a_distribution_brings_is_a_package_wherever_it_lies(plugin, tmp_path, monkeypatch):
    # As by PYTHONPATH, --user, a .pth file, conda or a system's dist-packages; and by pip install -e.
    elsewhere, sources = tmp_path / "elsewhere", tmp_path / "project of mine" / "src"
    for place, name in ((elsewhere, "far_package"), (sources, "edited_package")):
        (place / name).mkdir(parents=True)
        (place / name / "__init__.py").write_text("x = 1\n")
        monkeypatch.syspath_prepend(place)
    install(elsewhere, "far_package", "far_package/__init__.py")
    install(elsewhere, "edited_package", url=sources.parent.as_uri())
    plugin.write_text("import edited_package, far_package\n")
    fingerprints._edited_in_place.cache_clear()
    found = fingerprints.fingerprint(str(plugin))
    fingerprints._edited_in_place.cache_clear()
    assert set(found.code) == {"mine.py"}
    assert found.packages == {"far_package": "1.2", "edited_package": "1.2"}


def test_the_build_of_a_package_is_no_part_of_its_version(monkeypatch):
    fingerprints._versions.cache_clear()
    monkeypatch.setattr(importlib.metadata, "version", lambda _: "2.1.0+cpu")
    assert fingerprints._versions("torch") == (("torch", "2.1.0"),)
    fingerprints._versions.cache_clear()


# What another process has found out ---------------------------------------------------------------------------------


def test_what_another_process_has_parsed_is_not_parsed_again_but_an_edit_is_noticed(package, monkeypatch):
    before = fingerprints.fingerprint("toyparty.method", "benchmark.geometry.geodesics")
    known = pickle.loads(pickle.dumps(fingerprints.export_cache()))  # noqa: S301
    monkeypatch.setattr(fingerprints, "_PARSED", {})
    monkeypatch.setattr(fingerprints, "_BRINGERS", {})
    fingerprints.clear_cache()
    fingerprints._versions.cache_clear()
    fingerprints.import_cache(known)
    with monkeypatch.context() as patch:
        patch.setattr(fingerprints.ast, "parse", None)
        patch.setattr(fingerprints, "_distributions", None)
        assert fingerprints.fingerprint("toyparty.method", "benchmark.geometry.geodesics") == before
    assert changes(package / "helper.py", "def twice(x):\n    return 3 * x\n", "toyparty.method")


# Digests -------------------------------------------------------------------------------------------------------------


def test_digest_ignores_the_order_of_a_dict_and_the_type_of_a_number():
    assert keys.digest({"a": 1, "b": (1, 2)}) == keys.digest({"b": [1, 2], "a": np.int64(1)})
    assert keys.digest({"a": 1}) != keys.digest({"a": 2})
    with pytest.raises(TypeError, match="cannot be part of a recipe"):
        keys.digest({"a": object()})


def test_fields_that_only_some_versions_of_python_have_change_nothing(monkeypatch):
    """Python 3.12 gave functions and classes the empty list ``type_params``; here it is given to each, and not."""
    import ast

    found = {}
    for fields in ((), ("type_params",)):
        real = ast.iter_fields

        def with_new_fields(node, fields=fields, real=real):
            yield from ((name, value) for name, value in real(node) if name != "type_params")
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                yield from ((name, []) for name in fields)
                yield from ((f"{name}_more", None) for name in fields)

        monkeypatch.setattr(ast, "iter_fields", with_new_fields)
        monkeypatch.setattr(fingerprints, "_PARSED", {})
        fingerprints.clear_cache()
        found[fields] = fingerprints.fingerprint("baselines.classic_mds").digest
        monkeypatch.setattr(ast, "iter_fields", real)
    assert len(set(found.values())) == 1


def test_digests_agree_between_processes_and_nothing_heavy_is_imported():
    command = (
        "import sys\nfrom benchmark.system import fingerprints\n"
        "print(fingerprints.fingerprint('learned.paired.methods', 'benchmark.jobs.stages.form').digest)\n"
        "print([n for n in ('torch', 'numba', 'scipy', 'igl', 'learned', 'baselines') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True, cwd=ROOT)
    digest, heavy = done.stdout.strip().splitlines()
    assert digest == fingerprints.fingerprint("learned.paired.methods", "benchmark.jobs.stages.form").digest
    assert heavy == "[]"
