"""The wheel: what is in it, how large it is, and what is said where a model is left out; and one
version everywhere.
"""

import re
import runpy
import tomllib
from pathlib import Path

import pytest
import setuptools

from benchmark.api.learning import CARD, WEIGHTS
from benchmark.files import file_digest
from benchmark.protocols import models
from benchmark.protocols.models import MissingModel, with_model
from benchmark.protocols.published_models import published_files
from benchmark.registry import by_name, select_one
from learned.methods import Learned

ROOT = Path(__file__).parents[1]

#: Bytes of the models, and of all files, before a wheel compresses them; the wheel has at most
#: 25 MB.
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
    models = {name for name in packed if name.endswith("weights.safetensors")}
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
    pictures = [path.relative_to(ROOT) for path in (ROOT / "results/figures/rows").iterdir()]
    assert {f"benchmark/{path}" for path in pictures} <= packed.keys()
    assert "benchmark/results/figures/two-scorers.csv" in packed
    assert not any(name.startswith(("tests/", "tools/", "results/")) for name in packed)


def test_the_wheel_has_each_file_that_is_a_part_of_the_code_of_a_method(packed):
    for method in by_name("method").values():
        folder = method.target.partition(":")[0].rpartition(".")[0].replace(".", "/")
        assert {f"{folder}/{file}" for file in method.info.files} <= packed.keys(), method.name


def test_a_model_that_is_left_out_is_named_with_two_ways_to_get_it(monkeypatch, tmp_path):
    spec = select_one("learned[training_seed=7]")
    recipe = "-o resolution=128 -o stretch_depth=true -o epochs=60"
    remedy = f"run `python -m benchmark train [^`]* {recipe}`$"
    with pytest.raises(MissingModel, match=f"needs the model people-fold-0; {remedy}"):
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


def test_a_published_model_that_is_left_out_can_be_fetched(monkeypatch, tmp_path):
    monkeypatch.setattr(Learned, "shipped_models", tmp_path)
    fetch = "`python -m benchmark models fetch people-fold-0 --from CHECKOUT/learned/models`"
    with pytest.raises(MissingModel, match=f"train [^`]*`, or run {fetch}$"):
        with_model(select_one("learned"))


def test_the_list_of_published_models_is_that_of_the_committed_ones():
    every = [
        path
        for name in (WEIGHTS, CARD)
        for path in (ROOT / "learned" / "models").glob(f"*/*/{name}")
    ]
    files = {path.relative_to(ROOT / "learned" / "models").as_posix(): path for path in every}
    assert published_files().keys() == files.keys()
    for name, digest in published_files().items():
        assert file_digest(files[name]) == digest, name
