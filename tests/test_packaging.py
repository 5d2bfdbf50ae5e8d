"""The wheel: what is in it, how large it is, and what is said where a model is left out; and one version everywhere."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest
import setuptools

from benchmark.protocols import models
from benchmark.protocols.models import MissingModel, with_model
from benchmark.registry import select_one

ROOT = Path(__file__).parents[1]

#: Bytes of the models, and of all files, of a wheel, which compresses models by a twelfth.
LARGEST_MODELS, LARGEST = 22e6, 30e6


@pytest.fixture(scope="module")
def packed():
    """Files of the wheel, by their places in it; taken from the build, which copies nothing."""
    given = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, "setup", lambda **passed: given.update(passed))
        runpy.run_path("setup.py")
        made = setuptools.Distribution({**given, "script_name": "setup.py"})
        made.parse_config_files()
        made.include_package_data = (
            False  # there is no manifest; looking for one would write into the checkout
        )
        build = made.get_command_obj("build_py")
        build.ensure_finalized()
        files_of = {
            f"{module[0].replace('.', '/')}/{Path(module[2]).name}": ROOT / module[2]
            for module in build.find_all_modules()
        }
        for package, source, _, files in build.data_files:
            files_of |= {
                f"{package.replace('.', '/')}/{name}": ROOT / source / name for name in files
            }
    return files_of


def test_the_wheel_has_the_models_of_people_and_animals_and_stays_small(packed):
    models = {name for name in packed if name.endswith(".safetensors")}
    assert {name.split("/")[2] for name in models} == {"humans-varied", "animals-sampled"}
    assert all(name.replace("weights.safetensors", "card.json") in packed for name in models)
    assert sum(packed[name].stat().st_size for name in models) < LARGEST_MODELS
    assert sum(path.stat().st_size for path in packed.values()) < LARGEST


def test_the_wheel_has_types_templates_and_examples_and_no_tests(packed):
    assert {
        f"{name}/py.typed" for name in ("benchmark", "baselines", "learned", "retrieval")
    } <= packed.keys()
    assert "benchmark/check/shapes.npz" in packed
    assert {
        f"benchmark/examples/{name}" for name in ("ray_stretch.py", "graph_stress.cpp")
    } <= packed.keys()
    assert {
        "benchmark/reference/references.bib",
        "benchmark/report/templates/table.html",
    } <= packed.keys()
    records = [path for path in (ROOT / "results/records").rglob("*") if path.is_file()]
    assert {f"benchmark/{path.relative_to(ROOT)}" for path in records} <= packed.keys()
    assert not any(name.startswith(("tests/", "tools/", "results/")) for name in packed)


def test_a_model_that_is_left_out_is_named_with_two_ways_to_get_it(monkeypatch, tmp_path):
    spec = select_one("learned[training_seed=7]")
    remedies = "run `python -m benchmark train [^`]*`, or name the folder learned/models .* in CANONICAL_FORMS_MODELS"
    with pytest.raises(MissingModel, match=f"needs the model people-fold-0; {remedies}"):
        with_model(spec)
    (tmp_path / "people-fold-0").mkdir()
    made = ROOT / "learned" / "models" / "people-fold-0" / "literal-seed0"
    (tmp_path / "people-fold-0" / "literal-seed7").symlink_to(made)
    monkeypatch.setenv(models.MODELS_VARIABLE, str(tmp_path))
    assert with_model(spec).model == tmp_path / "people-fold-0" / "literal-seed7"


def test_one_version_stands_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert re.search(r"^## \[?(\d[\d.]*)", (ROOT / "CHANGELOG.md").read_text(), re.M)[1] == version
