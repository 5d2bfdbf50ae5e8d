"""A learner through the command line: trained, tested, and refused where it must be."""

import json
import math
import shlex

import pytest

from benchmark.api.learning import read_card
from benchmark.errors import ConfigurationError
from tests import verbs
from tests.mean_target import PLUGIN_PATH, write_model
from tests.toy import rod, write_off

#: Width and bends of each class: the smallest set that looks like TOSCA.
CLASSES = {"cat": 0.08, "dog": 0.1, "horse": 0.2, "wolf": 0.14}


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    for name, radius in CLASSES.items():
        for number, bend in enumerate((1.0, 1.5, 2.0)):  # a straight one would be seen end on
            write_off(folder / "tosca" / f"{name}{number}.off", rod(radius, bend, rings=12, sides=8))
    return folder


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return tmp_path_factory.mktemp("results")


def call(*arguments, code=0):
    return verbs.call(*arguments, "--plugin", PLUGIN_PATH, code=code)


def test_a_model_is_trained_once_and_its_row_names_what_it_has_seen(results, root):
    train = ("train", "mean-target", "-t", "III", "--results", results, "--data-root", root)
    said = call(*train, "-o", "epochs=3", "-o", "speed=fast").splitlines()
    folder = results / "models" / "tosca-III" / "plain-seed0"
    assert said[0] == "mean-target, tosca-III"
    assert said[1] == "6 of 6 pairs, 6 held out, [('epochs', '3'), ('speed', 'fast')]"
    assert said[2] == f"the model is in {folder}"
    card = json.loads((folder / "card.json").read_text())
    assert card["subjects"] == ["dog", "wolf"]
    assert card["identifiers"] == ["dog0", "dog1", "dog2", "wolf0", "wolf1", "wolf2"]
    before = (folder / "card.json").stat().st_mtime_ns
    assert "finished before" in call(*train)
    assert (folder / "card.json").stat().st_mtime_ns == before
    selection = ("-t", "III-view", "-m", "mean-target", "--results", results)
    told = " ".join(call("run", *selection, "--data-root", root, "-j", "0").split())
    assert "Mean target" in told
    assert "Seen in training: Mean target 6 of 12 (all shapes)." in told


def test_without_a_model_the_plan_names_the_command_that_trains_it(root, tmp_path):
    arguments = ("-m", "mean-target[training_seed=1]", "--results", tmp_path, "--data-root", root, "-t", "III-view")
    told = call("plan", *arguments)
    assert "unavailable  tosca view mean-target[training_seed=1]" in told
    command = shlex.split(told.split("`")[1])
    assert command[3:7] == ["train", "mean-target[training_seed=1]", "--table", "tosca-III"]
    call("run", *arguments, "-j", "0", code=1)
    call(*command[3:-2], "--results", tmp_path, "--data-root", root)
    assert "2 of 2 jobs to run" in call("plan", *arguments)


def test_an_unusable_card_names_its_field(tmp_path):
    faults = {
        r"at `\$.subjects`": {"subjects": None},
        r"at `\$.digest`": {"digest": "abc"},
        "malformed": {"note": math.nan},
    }
    for said, change in faults.items():
        write_model(tmp_path, 0.7, **change)
        with pytest.raises(ConfigurationError, match=f"{said}.*; train the model again"):
            read_card(tmp_path)


def test_other_weights_are_another_model(root, tmp_path):
    folder = tmp_path / "models" / "tosca-III" / "plain-seed0"
    arguments = ("-t", "III-view", "-m", "mean-target", "--results", tmp_path, "--data-root", root)
    write_model(folder, 0.7)
    call("run", *arguments, "-j", "0")
    assert call("plan", *arguments).startswith("finished")
    write_model(folder, 0.8)
    plan = call("plan", *arguments)
    assert plan.startswith("stale")
    assert "the model tosca-III changed" in plan


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("mean-targt",), "unknown method 'mean-targt'; did you mean mean-target"),
        (("mean-target", "--table", "VI"), "unknown table or training 'VI'"),
        (("mean-target", "-t", "people-strict-4-0"), "unknown table or training 'people-strict-4-0'"),
        (("mean-target", "-o", "jitter"), "'jitter' has no value; write NAME=VALUE"),
        (("gps",), "method 'gps' is not a learner"),
    ],
)
def test_what_cannot_be_trained_is_named(arguments, message, tmp_path):
    assert message in call("train", *arguments, "--results", tmp_path, code=2)
