"""What a digest of code follows, and what it does not."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from benchmark import code_digest as module
from benchmark.code_digest import code_digest, code_of, modules_beside
from benchmark.errors import ConfigurationError
from tests.registry.plugin import write_plugin


@pytest.fixture
def plugin(tmp_path):
    (tmp_path / "helper.py").write_text("from package.inner import value\n\nFACTOR = value()\n")
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text("")
    (tmp_path / "package" / "inner.py").write_text(
        "def value():\n    from . import late\n    return late.VALUE\n"
    )
    (tmp_path / "package" / "late.py").write_text("VALUE = 1\n")
    (tmp_path / "unused.py").write_text("VALUE = 1\n")
    (tmp_path / "random.py").write_text("VALUE = 1\n")
    (tmp_path / "table.csv").write_text("1\n")
    return write_plugin(
        tmp_path / "smooth.py", imports="import random\nimport numpy\nimport helper"
    )


def touch(path, text):
    path.write_text(text)
    os.utime(path, ns=(1, 1))  # another time, however fast the test is


EDITS = {
    "smooth.py": ("shape.form", "1 and shape.form"),
    "helper.py": ("FACTOR =", "FACTOR = 2 *"),
    "package/inner.py": ("late.VALUE", "late.VALUE + 1"),
    "package/late.py": ("1", "2"),
    "table.csv": ("1", "2"),
}


@pytest.mark.parametrize(("name", "edit"), EDITS.items(), ids=EDITS)
def test_an_edit_of_what_a_plugin_imports_or_names_changes_the_digest(plugin, name, edit):
    before, parts = code_digest(str(plugin), ["table.csv"]), code_of(str(plugin), ["table.csv"])
    path = plugin.parent / name
    touch(path, path.read_text().replace(*edit))
    assert code_digest(str(plugin), ["table.csv"]) != before
    after = code_of(str(plugin), ["table.csv"])
    assert {part for part in after if after[part] != parts.get(part)} == {name}


def test_all_bytes_of_a_users_file_count_and_those_of_no_other_file(plugin):
    before = code_digest(str(plugin))
    touch(plugin.parent / "unused.py", "VALUE = 2\n")
    touch(plugin.parent / "random.py", "VALUE = 2\n")  # the plugin gets the standard module
    assert code_digest(str(plugin)) == before
    text = plugin.read_text()
    for edited in (
        text.replace("Smoothed surface.", "Other."),
        text.replace('title="Smooth"', 'title="S"'),
        text + "#",
    ):
        touch(plugin, edited)
        assert edited != text
        assert code_digest(str(plugin)) != before


@pytest.fixture
def digest_in_suite(tmp_path, monkeypatch):
    """A function that returns the digest of a text as that of a module of the suite."""
    monkeypatch.setattr(module, "ROOT", tmp_path)
    monkeypatch.setattr(module, "FIRST_PARTY", ("suite",))
    (tmp_path / "suite").mkdir()

    def digest(text):
        touch(tmp_path / "suite" / "part.py", text)
        module._parsed_once.cache_clear()
        return module._parsed(tmp_path / "suite" / "part.py").digest

    return digest


def test_docstrings_and_comments_of_the_suite_do_not_count(digest_in_suite):
    one = digest_in_suite('"""One."""\nVALUE = 1')
    assert digest_in_suite('"""Another."""  # why\n\nVALUE = (1)') == one
    assert digest_in_suite("VALUE = 2") != one


def test_messages_of_the_suite_do_not_count_and_what_they_show_and_when_does(digest_in_suite):
    lines = (
        "def check(n, kind):",
        "  if n > 3:",
        '    hint = "drop some"',
        '    raise ValueError(f"{n} are many", hint)',
    )
    code = "\n".join(lines)
    before = digest_in_suite(code)
    assert (
        digest_in_suite(code.replace("are many", "are too many").replace("drop", "leave out"))
        == before
    )
    for old, new in (("> 3", "> 4"), ("{n}", "{kind}"), ("ValueError", "TypeError")):
        assert digest_in_suite(code.replace(old, new)) != before


def test_texts_that_are_no_messages_count(digest_in_suite):
    assert digest_in_suite('start = "mesh"') != digest_in_suite('start = "classic"')


def test_bounds_of_parameters_and_texts_for_tables_do_not_count_and_defaults_do(digest_in_suite):
    lines = (
        "class Smooth:",
        '  info = MethodInfo(name="smooth", title="Smooth", summary="smooths", cite="lian2013")',
        "  steps: Annotated[int, Interval(1)] = 3",
    )
    code = "\n".join(lines)
    before = digest_in_suite(code)
    for old, new in (("Interval(1)", "Interval(2)"), ('Smooth"', 'Smoothed"'), ("smooths", "is")):
        assert digest_in_suite(code.replace(old, new)) == before
    for old, new in (("= 3", "= 4"), ("[int", "[float"), ('"smooth"', '"rough"')):
        assert digest_in_suite(code.replace(old, new)) != before


def test_definitions_tell_what_changed_in_a_file_of_the_suite(digest_in_suite):
    code = (
        "import os\nLIMIT = 1\nclass A:\n  size = 2\n  def f(self):\n    return 1\ndef g(): pass\n"
    )

    def definitions(text):
        digest_in_suite(text)
        return module._parsed(module.ROOT / "suite" / "part.py").definitions

    before = definitions(code)
    assert before.keys() == {"imports", "LIMIT", "A", "A.size", "A.f", "g"}
    for old, new, changed in (
        ("LIMIT = 1", "LIMIT = 2", "LIMIT"),
        ("return 1", "return 2", "A.f"),
        ("size = 2", "size = 3", "A.size"),
        ("class A:", "class A(dict):", "A"),
        ("pass", "return 1", "g"),
        ("import os", "import re", "imports"),
    ):
        after = definitions(code.replace(old, new))
        assert {name for name in before if before[name] != after[name]} == {changed}


def test_what_describes_the_machine_and_errors_is_no_code_of_a_form():
    code = code_of("baselines.identity")
    others = {"benchmark/errors.py", "benchmark/text.py", "psutil", "joblib", "threadpoolctl"}
    assert not others & code.keys()


def test_a_version_is_that_of_the_package_that_python_imports(tmp_path):
    for folder, version in (("first", "2.0"), ("second", "1.0")):
        for path in (tmp_path / folder / "known", tmp_path / folder / f"known-{version}.dist-info"):
            path.mkdir(parents=True)
        (path / "METADATA").write_text(f"Metadata-Version: 2.1\nName: known\nVersion: {version}\n")
        (path / "RECORD").write_text("known/__init__.py,,\n")
        (tmp_path / folder / "known" / "__init__.py").write_text("VALUE = 1\n")
    (tmp_path / "beside").mkdir()
    (tmp_path / "plugin.py").write_text("import known\n")
    plugin = str(tmp_path / "plugin.py")
    program = f"from benchmark.code_digest import code_of; print(code_of({plugin!r}))"

    def code(*folders):
        path = os.pathsep.join(str(tmp_path / folder) for folder in folders)
        run = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONPATH": path},
            capture_output=True,
        )
        return {name: part for name, part in eval(run.stdout).items() if name != "plugin.py"}  # noqa: S307

    assert code("first", "second") == {"known": "2.0"}
    assert code("second", "first") == {"known": "1.0"}
    (tmp_path / "beside" / "known.py").write_text(
        "VALUE = 2\n"
    )  # no distribution, so its source counts
    assert [*code("beside", "first")] == ["known.py"]


def test_a_compiled_extension_counts_by_its_content(plugin):
    extension = plugin.with_name("fast.abi3.so")
    extension.write_bytes(b"\x7fELF 1")
    write_plugin(plugin, imports="import fast")
    before = code_of(str(plugin))
    assert "fast.abi3.so" in before
    extension.write_bytes(b"\x7fELF 22")
    assert code_of(str(plugin))["fast.abi3.so"] != before["fast.abi3.so"]


def test_an_import_under_any_condition_counts(plugin):
    write_plugin(
        plugin, imports="class S:\n    TYPE_CHECKING = True\nif S.TYPE_CHECKING:\n    import unused"
    )
    assert "unused.py" in code_of(str(plugin))


@pytest.mark.parametrize(("name", "what"), [("tabel.csv", "missing"), ("package", "a folder")])
def test_a_file_that_is_not_there_is_an_error(plugin, name, what):
    with pytest.raises(
        ConfigurationError, match=rf"smooth.py depends on '{name}', which is {what}"
    ):
        code_of(str(plugin), [name])


def test_modules_beside_a_plugin_are_named(plugin):
    assert modules_beside(plugin) == {
        "helper": plugin.parent / "helper.py",
        "package": plugin.parent / "package" / "__init__.py",
    }


def test_a_broken_source_is_left_to_its_import(plugin):
    plugin.write_text("def broken(:\n")
    assert code_digest(str(plugin))


def test_nothing_is_imported(plugin):
    program = (
        f"import sys, benchmark.code_digest as c; c.code_of({str(plugin)!r}); "
        "print('numpy' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False\n"


def test_all_modules_of_a_package_without_a_version_count(plugin, tmp_path_factory, monkeypatch):
    folder = tmp_path_factory.mktemp("elsewhere")
    for name in ("__init__.py", "inner.py"):
        (folder / "lazy_library").mkdir(exist_ok=True)
        (folder / "lazy_library" / name).write_text("VALUE = 1\n")
    (folder / "lazy_library" / ".#inner.py").symlink_to("user@machine.1234")  # of an editor
    monkeypatch.syspath_prepend(folder)
    write_plugin(plugin, imports="import lazy_library")
    assert "lazy_library/inner.py" in code_of(str(plugin))
