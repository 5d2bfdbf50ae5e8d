"""Models that the networks of a selection lack: those of published tables, and no others."""

import os
from collections import Counter
from itertools import pairwise
from subprocess import CompletedProcess

import pytest

from benchmark.api.learning import CARD
from benchmark.registry import by_name, select_one
from benchmark.registry.modules import load_module
from benchmark.runs.lacking import LackingModel, lacking_models, train_lacking
from learned.fitting import TRAINABLE
from learned.models import CONFIGURATIONS
from tests.registry.plugin import write_plugin

STRICT = "learned-strict"


def named(lacking):
    return {(model.method, model.training) for model in lacking}


def test_table_iv_needs_two_strict_models_of_twelve_folds(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.protocols.galleries.has_model", lambda *_: False)
    lacking = lacking_models(tmp_path, tables=["IV"], methods=[STRICT])
    folds = [f"people-strict-{fold}-{poses}" for fold in range(3) for poses in range(4)]
    seeds = (STRICT, f"{STRICT}[training_seed=1]")
    assert named(lacking) == {(name, fold) for name in seeds for fold in folds}
    assert {tuple(model.options.items()) for model in lacking} == {
        (("resolution", 128), ("stretch_depth", True), ("epochs", 60))
    }
    assert all(model.seconds and model.seconds > 0 for model in lacking)
    words = lacking[0].words(tmp_path, None)
    assert words[:4] == ["train", lacking[0].method, "-t", lacking[0].training]
    assert "stretch_depth=true" in words and "epochs=60" in words


def test_a_model_that_is_there_is_not_lacking(tmp_path):
    methods = [f"{STRICT}[training_seed=5]"]
    first, *others = lacking_models(tmp_path, tables=["IV"], methods=methods)
    learner = select_one(first.method).create()
    folder = tmp_path / "models" / first.training / learner.model_name
    folder.mkdir(parents=True)
    (folder / CARD).write_text("{}")
    after = lacking_models(tmp_path, tables=["IV"], methods=methods)
    assert named(after) == named(others)
    assert len(after) == 11


def test_chosen_parameters_are_trained_alone(tmp_path):
    lacking = lacking_models(tmp_path, tables=["IV"], methods=[f"{STRICT}[training_seed=5]"])
    assert Counter(model.method for model in lacking) == {f"{STRICT}[training_seed=5]": 12}


def test_networks_that_come_with_the_suite_or_are_frozen_lack_nothing(tmp_path):
    shipped = ["learned", "learned-wide-extra", "learned-streamed"]
    methods = [*shipped, "deformation-field", "learned-wide-extra[training=animals-sampled]"]
    assert lacking_models(tmp_path, tables=["I", "II", "III"], methods=methods) == []
    assert lacking_models(tmp_path, tables=["I"], methods=["gps"]) == []


@pytest.mark.parametrize("training", ["people-fold-0", "tosca-III", "humans-sampled", "own-x"])
def test_what_is_lacking_can_be_trained_whatever_training_is_named(tmp_path, training):
    names = [name for name, method in by_name("method").items() if method.learns]
    methods = [f"{name}[training={training},training_seed=9]" for name in names]
    methods += [
        f"learned[configuration={configuration},training={training},training_seed=9]"
        for configuration in CONFIGURATIONS
    ]
    lacking = lacking_models(tmp_path, tables=["I", "II"], methods=methods)
    trained = {select_one(model.method).create().configuration for model in lacking}
    trainable = {name for name, each in CONFIGURATIONS.items() if each.architecture in TRAINABLE}
    has_data = training in ("people-fold-0", "humans-sampled")
    assert trained == (trainable if has_data else set())
    assert all(model.seconds and model.seconds > 0 for model in lacking)


def test_controls_share_the_models_of_their_network(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.protocols.galleries.has_model", lambda *_: False)
    methods = ["learned", "learned-average", "learned-flat"]
    lacking = lacking_models(tmp_path, tables=["IV"], methods=methods)
    assert named(lacking) == {
        (name, f"people-fold-{fold}")
        for name in ("learned", "learned[training_seed=1]")
        for fold in range(3)
    }


def test_options_of_a_recipe_are_passed_as_they_are(tmp_path):
    options = {"optimiser": "AdamW", "stretch": False, "rate": 1e-5, "sizes": (1, 2)}
    words = LackingModel("own", None, "people", options, None).words(tmp_path, None)
    passed = [word for before, word in pairwise(words) if before == "-o"]
    assert passed == ["optimiser=AdamW", "stretch=false", "rate=1e-05", "sizes=(1,2)"]


def test_what_a_plugin_sets_in_the_environment_reaches_no_training(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmark.registry.modules._changed", {})
    monkeypatch.setenv("OF_USER", "of the user")
    sets = "import os\nos.environ['OF_USER'] = 'of the plugin'"
    load_module(str(write_plugin(tmp_path / "smooth.py", imports=sets)))
    passed = {}

    def run(command, *, env=None, check):
        passed.update(os.environ if env is None else env)
        return CompletedProcess(command, 0)

    monkeypatch.setattr("subprocess.run", run)
    train_lacking([LackingModel("own", None, "people", {}, None)], tmp_path, None, print)
    assert passed["OF_USER"] == "of the user"


def test_a_checkout_has_the_models_of_all_rows_of_generated_data(tmp_path):
    assert lacking_models(tmp_path) == []
