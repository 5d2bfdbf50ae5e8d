"""The plugin that ``new method`` writes works as it is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import registry
from benchmark.plugins.conformance import check_target
from benchmark.plugins.scaffold import new_plugin

ROOT = Path(__file__).parents[2]


def python(*arguments):
    clean = {name: value for name, value in os.environ.items() if name != "CANONICAL_FORMS_DATA"}
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=280, check=False, env=clean)


def test_the_plugin_keeps_the_contract(tmp_path):
    plugin, test = new_plugin("method", "ray-stretch", tmp_path / "mine")
    assert [plugin.name, test.name] == ["ray_stretch.py", "test_ray_stretch.py"]
    (spec,) = registry.plugin_methods(plugin)
    assert (spec.name, spec.info.title, spec.load().__name__) == ("ray-stretch", "Ray Stretch", "RayStretch")
    report = check_target(str(plugin))
    assert report, f"\n{report}"
    assert len(plugin.read_text().splitlines()) <= 40


@pytest.mark.slow
def test_the_test_bites(tmp_path):
    plugin, test = new_plugin("method", "ray-stretch", tmp_path)
    plugin.write_text(plugin.read_text().replace("rays * stretch[:, None]", "rays + [1, 0, 0] * rays"))
    done = python("pytest", "-p", "no:cacheprovider", test)
    assert "2 failed" in done.stdout
    assert "rigid motion" in done.stdout


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("RayStretch", "'RayStretch' cannot be the name of a method; join lower-case words by hyphens: ray-stretch"),
        ("ray_stretch", "join lower-case words by hyphens: ray-stretch"),
        ("../evil", "join lower-case words by hyphens: evil"),
        ("ray-", "hyphens: ray"),
        ("2d", "join lower-case words by hyphens$"),
        ("", "join lower-case words by hyphens$"),
        ("gps", "there is already a method 'gps'; choose another name"),
        ("surface-area", "already"),
        ("all", "already"),
        ("lambda", "'lambda' has another meaning in the file; choose another name: my-lambda"),
        ("none", "my-none"),
        ("shape", "my-shape"),
        ("method-info", "my-method-info"),
        ("json", "json.py would hide the Python module 'json'; choose another name: my-json"),
        ("numpy", "would hide"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused_with_a_better_one(name, message, tmp_path):
    with pytest.raises(ConfigurationError, match=message):
        new_plugin("method", name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("existing", ["mine_too.py", "test_mine_too.py"])
def test_nothing_is_overwritten_and_nothing_half_written(existing, tmp_path):
    (tmp_path / existing).write_text("dear to me")
    with pytest.raises(ConfigurationError, match=f"{existing} exists already"):
        new_plugin("method", "mine-too", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [existing]
    assert (tmp_path / existing).read_text() == "dear to me"
