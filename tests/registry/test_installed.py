"""Methods and scorers of installed packages."""

from __future__ import annotations

import pytest

from benchmark.code_digest import code_of
from benchmark.errors import ConfigurationError
from benchmark.registry import by_name, known, select_one
from tests.registry.plugin import write_plugin


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with a method that works, one that cannot be imported, and one under another name."""
    write_plugin(tmp_path / "my_methods" / "__init__.py", imports="from my_methods.inner import FACTOR")
    (tmp_path / "my_methods" / "inner.py").write_text("FACTOR = 1\n")
    write_plugin(tmp_path / "my_methods" / "broken.py", imports="1 / 0")
    info = tmp_path / "my_methods-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-methods\nVersion: 1.0\n")
    points = "smooth = my_methods:Smooth\nbroken = my_methods.broken:Smooth\nother = my_methods:Smooth\n"
    (info / "entry_points.txt").write_text(f"[canonical_forms.methods]\n{points}")
    monkeypatch.syspath_prepend(tmp_path)
    known._installed.cache_clear()
    yield tmp_path
    known._installed.cache_clear()


def test_a_package_brings_what_works_and_the_rest_is_named_when_it_is_asked_for(package):
    assert list(by_name("method"))[-1] == "smooth"
    component = select_one("smooth")
    assert (component.target, component.plugin, component.of_suite) == ("my_methods:Smooth", None, False)
    assert component.create().info.title == "Smooth"
    with pytest.raises(
        ConfigurationError, match="my_methods.broken cannot be imported: broken.py:8: ZeroDivisionError"
    ):
        select_one("broken")
    with pytest.raises(ConfigurationError, match="'smooth' is registered as 'other' by an installed package"):
        select_one("other")


def test_modules_of_its_package_are_part_of_its_code(package):
    parts = code_of("my_methods:Smooth")
    assert {"my_methods/__init__.py", "my_methods/inner.py", "benchmark/api/contracts.py"} <= parts.keys()
    assert "my_methods/broken.py" not in parts


def test_what_cannot_be_used_is_said_once(package, capsys):
    for _ in range(2):
        by_name("method")
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert "broken.py:8: ZeroDivisionError: division by zero" in said[0]
