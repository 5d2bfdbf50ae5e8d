"""A learner through the command line: trained, tested, told about, and refused where it must be."""

import json
import shlex

import pytest
from benchmark.cli.plan import planned_jobs
from typer.testing import CliRunner

from benchmark.api.learning import read_card
from benchmark.cli.main import cli
from benchmark.cli.options import Selection
from benchmark.cli.run import Settings, run_plan
from benchmark.cli.train import train_one
from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, variant
from benchmark.protocols.trainings import find_training
from tests.mean_target import PLUGIN_PATH, write_model
from tests.toy import rod, write_off

pytestmark = pytest.mark.usefixtures("forked_workers")

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


def call(*arguments, fails=False):
    result = CliRunner().invoke(cli, [*map(str, arguments), "--plugin", str(PLUGIN_PATH)])
    if isinstance(result.exception, BenchmarkError):
        assert fails
        return str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.output
    assert (result.exit_code != 0) == fails, result.output
    return result.output


def run(table, results, root, method="mean-target", fails=False):
    selection = ("-t", table, "-m", method, "--input", "view", "--results", results, "--data-root", root)
    return call("run", *selection, "-j", "0", fails=fails)


def rows(table, results, method="mean-target"):
    selection = ("-t", table, "-m", method, "--input", "view", "--results", results)
    found = json.loads(call("tables", *selection, "--format", "json"))
    return [row for row in found if row["method"] == method]


@pytest.fixture(scope="module")
def trained(results, root):
    """What the verb said of the first training."""
    return call(
        "train", "mean-target", "--table", "III", "-o", "epochs=3", "-o", "speed=fast", "--results", results,
        "--data-root", root,
    )  # fmt: skip


def test_train_makes_the_model_of_a_table_and_says_where(trained, results):
    folder = results / "models" / "tosca-III" / "plain-seed0"
    said = trained.splitlines()
    assert said[0] == "mean-target, tosca-III"
    assert said[1] == "6 of 6 pairs, 6 held out, [('epochs', 3), ('speed', 'fast')]"
    assert said[2] == f"the model is in {folder}"
    card = json.loads((folder / "card.json").read_text())
    assert card["subjects"] == ["dog", "wolf"]
    assert card["identifiers"] == ["dog0", "dog1", "dog2", "wolf0", "wolf1", "wolf2"]


def test_a_finished_model_is_left_alone(trained, results, root):
    card = results / "models" / "tosca-III" / "plain-seed0" / "card.json"
    before = card.stat().st_mtime_ns
    again = call("train", "mean-target", "--table", "III", "--results", results, "--data-root", root)
    assert "finished before" in again
    assert card.stat().st_mtime_ns == before


def test_table_three_tells_of_the_training_and_of_shapes_that_were_seen(trained, results, root):
    text = run("III", results, root)
    assert "| Mean target" in text
    assert "- Mean target: trained on tosca-III: one pass" in text
    assert "The paper's schedule" not in text
    assert "- Mean target, view: 6 of 12 shapes were seen in training" in text
    assert "**Table III-held-out. Retrieval of cats and horses alone" in text
    assert "TOSCA (6 shapes, 2 classes)" in text
    whole, held_out = rows("III", results)
    assert (whole["table"], whole["n_shapes"], whole["n_models"], whole["spread"]) == ("III", 12, 1, None)
    assert (held_out["table"], held_out["n_shapes"], held_out["paper"]) == ("III-held-out", 6, None)
    assert held_out["chance"]["NN"] == pytest.approx(2 / 5)


def test_a_seen_shape_is_an_error_where_all_must_be_unseen(root, tmp_path):
    write_model(tmp_path / "models" / "tosca-III" / "plain-seed0", 0.7, ("cat1", "dog0"), ("dog",))
    text = run("III-held-out", tmp_path, root, fails=True)
    assert "Mean target, view: failed: 1 shapes were seen in training: cat1; test on shapes" in text.replace("\n", " ")


def test_without_a_model_the_job_is_unavailable_and_says_what_makes_it(root, tmp_path):
    arguments = ("-m", "mean-target[training_seed=1]", "--results", tmp_path, "--data-root", root, "--input", "view")
    told = call("plan", "-t", "III-held-out", *arguments)
    assert told.startswith("unavailable  tosca held out view mean-target[training_seed=1]  needs the model tosca-III")
    command = shlex.split(told.split("`")[1])
    assert command[:3] == ["python", "-m", "benchmark"]
    assert command[3:7] == ["train", "mean-target[training_seed=1]", "--only", "tosca-III"]
    call(*command[3:-2], "--results", tmp_path, "--data-root", root)
    assert call("plan", "-t", "III-held-out", *arguments).startswith("missing")


def test_a_missing_model_is_a_failure_only_where_its_method_was_named(root, tmp_path):
    chosen = Selection(
        tables=("III-held-out",),
        methods=("mean-target[training_seed=2]",),
        input="view",
        plugins=(PLUGIN_PATH,),
        results=tmp_path,
        data_root=root,
    )
    store = Store.open(tmp_path)
    (job,) = planned_jobs(chosen, store)
    assert job.state == "unavailable"
    assert not run_plan([job], store, Settings(jobs=0), is_narrow=True)
    assert run_plan([job], store, Settings(jobs=0))


@pytest.mark.parametrize(
    ("card", "said"),
    [
        ({"subjects": None}, "at `$.subjects`; train the model again"),
        ({"subjects": []}, "length >= 1 - at `$.subjects`"),
        ({"identifiers": ["dog0", 7]}, "at `$.identifiers[1]`"),
        ({"digest": "abc"}, "at `$.digest`"),
        ({"data": "tosca-III "}, "was trained on 'tosca-III '; move it to the folder of its training data"),
        ({"extra_data": "no"}, "at `$.extra_data`"),
        ({"note": float("nan")}, "is no card of a model: JSON is malformed"),
    ],
)
def test_a_card_that_says_too_little_or_nonsense_is_named_before_any_shape_is_treated(root, tmp_path, card, said):
    write_model(tmp_path / "models" / "tosca-III" / "plain-seed0", 0.7, **card)
    selection = ("-t", "III-held-out", "-m", "mean-target", "--results", tmp_path, "--data-root", root)
    told = call("plan", *selection, "--input", "view")
    assert told.startswith("unavailable")
    assert said in told


def test_other_weights_or_another_card_are_another_model(root, tmp_path):
    folder = tmp_path / "models" / "tosca-III" / "plain-seed0"
    arguments = ("-t", "III-held-out", "-m", "mean-target", "--input", "view", "--data-root", root)
    write_model(folder, 0.7)
    run("III-held-out", tmp_path, root)
    assert call("plan", *arguments, "--results", tmp_path).startswith("cached")
    write_model(folder, 0.7, ("somebody0", "somebody1"))
    plan = call("plan", *arguments, "--results", tmp_path)
    assert plan.startswith("stale")
    assert "card.json changed" in plan  # which this learner reads
    write_model(folder, 0.8)
    plan = call("plan", *arguments, "--results", tmp_path)
    assert plan.startswith("stale")
    assert "models changed: tosca-III" in plan


def test_a_local_model_that_cannot_be_read_is_named_and_passed_over(root, tmp_path, monkeypatch):
    """The shipped one takes its place; trained again, the local one counts."""
    spec = variant("mean-target", methods([PLUGIN_PATH]))
    shipped, local = tmp_path / "shipped", tmp_path / "models" / "tosca-III" / "plain-seed0"
    monkeypatch.setattr(spec.load(), "shipped_models", shipped)
    write_model(shipped / "tosca-III" / "plain-seed0", 0.7)
    write_model(local, 0.7, note=float("nan"))
    options = ("--results", tmp_path, "--data-root", root)
    told = call("plan", "-t", "III-held-out", "-m", "mean-target", "--input", "view", *options).splitlines()
    assert told[0].startswith(
        f"skipped the model in {local}: {local / 'card.json'} is no card of a model: JSON is malformed"
    )
    assert told[1].startswith("missing      tosca held out view mean-target")
    train_one(spec.create(), find_training("tosca-III"), local, root, {}, (said := []).append)
    assert said[0].endswith(": renamed to unusable-card.json, training the model again")
    assert read_card(local).data == "tosca-III"


def test_options_of_train_are_parameters_of_the_method(root, tmp_path):
    call(
        "train",
        "mean-target",
        "-t",
        "III",
        "--seed",
        2,
        "--config",
        "other",
        "--results",
        tmp_path,
        "--data-root",
        root,
    )
    assert (tmp_path / "models" / "tosca-III" / "other-seed2" / "card.json").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("mean-targt",), "unknown method 'mean-targt'; did you mean mean-target"),
        (("mean-target", "--table", "VI"), "unknown table 'VI'"),
        (("mean-target", "--only", "humans-strict-4-0"), "unknown training 'humans-strict-4-0'"),
        (("mean-target", "-o", "jitter"), "'jitter' has no value; write NAME=VALUE"),
        (("mean-target[training=nothing]",), "unknown training 'nothing'"),
        (("learned-wide-extra",), "the bodies of 'humans-sampled' are not generated any more; take its model"),
    ],
)
def test_what_cannot_be_trained_is_named(arguments, message, tmp_path):
    assert message in call("train", *arguments, "--results", tmp_path, fails=True)


def test_canonicalise_gives_a_learner_a_depth_image(tmp_path):
    write_off(tmp_path / "rod.off", rod(0.1, 2.0))
    call("canonicalise", "-m", "mean-target", tmp_path / "rod.off", "-o", tmp_path / "form.off")
    assert (tmp_path / "form.off").read_text().startswith("OFF")
