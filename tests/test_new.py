"""The method that ``new`` writes works as it is, and its test finds a fault."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.check import failures
from benchmark.errors import ConfigurationError
from benchmark.new import new_method
from benchmark.registry.known import in_file

ROOT = Path(__file__).parents[1]


def test_the_method_keeps_the_contract(tmp_path):
    plugin, test = new_method("my-own", tmp_path / "mine")
    assert [plugin.name, test.name] == ["my_own.py", "test_my_own.py"]
    (component,) = in_file(plugin)
    assert (component.name, component.info.title, component.load().__name__) == ("my-own", "My Own", "MyOwn")
    assert not failures(component.load())
    assert "ray" not in plugin.read_text().replace("rays", "").replace("arrays", "").lower()


@pytest.mark.slow
@pytest.mark.parametrize(("new", "summary"), [("rays *", "2 passed"), ("[1, 0, 0] * rays *", "2 failed")])
def test_the_test_bites(tmp_path, new, summary):
    plugin, test = new_method("my-own", tmp_path)
    plugin.write_text(plugin.read_text().replace("rays *", new))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", test], cwd=tmp_path, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False,
    )  # fmt: skip
    assert summary in done.stdout


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("MyOwn", "'MyOwn' cannot be the name of a method; join lower-case words by hyphens, like ray-stretch"),
        ("../evil", "'../evil' cannot be the name of a method; join lower-case words by hyphens"),
        ("", "'' cannot be the name of a method; join lower-case words by hyphens"),
        ("gps", "there is already a method 'gps'; choose another name"),
        ("all", "already"),
        ("lambda", "'lambda' has another meaning in Python; choose another name: my-lambda"),
        ("shape", "my-shape"),
        ("numpy", "my-numpy"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused_with_a_better_one(name, message, tmp_path):
    with pytest.raises(ConfigurationError, match=message):
        new_method(name, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("existing", ["mine_too.py", "test_mine_too.py"])
def test_nothing_is_overwritten_and_nothing_half_written(existing, tmp_path):
    (tmp_path / existing).write_text("dear to me")
    with pytest.raises(ConfigurationError, match=f"{existing} exists already"):
        new_method("mine-too", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [existing]
