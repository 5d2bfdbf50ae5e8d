"""A learner through the command line: trained once, and tested with its model."""

import fcntl
import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from benchmark.api.learning import CARD
from benchmark.cli.run import _duration_of_trainings
from benchmark.commands.train import _only_training_of
from benchmark.errors import TrainingError
from benchmark.locks import take_lock
from benchmark.pipeline.cache import StorageError
from benchmark.protocols.models import folder_of_training, has_model
from benchmark.registry import select_one
from tests import verbs
from tests.runs.toy import LIGHT
from tests.toy import write_rods

#: The nearest neighbour among the images, which needs no network.
LEARNER = Path(__file__).parents[2] / "examples" / "nearest_view.py"


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    """The smallest set that looks like TOSCA; a straight rod would be seen end on."""
    folder = tmp_path_factory.mktemp("data")
    radii = {"cat": 0.08, "dog": 0.1, "horse": 0.2, "wolf": 0.14}
    write_rods(folder / "tosca", (1.0, 1.5, 2.0), rings=12, sides=8, radii=radii)
    return folder


def call(*arguments, code=0):
    return verbs.call(*arguments, "--plugin", LEARNER, code=code)


def test_a_model_is_trained_once_and_its_row_names_what_it_has_seen(root, tmp_path):
    train = ("train", "nearest-view", "-t", "III", "--results", tmp_path, "--data-root", root)
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    assert call(*train).splitlines() == [
        "nearest-view, tosca-III",
        "kept 6 pairs",
        f"the model is in {folder}",
    ]
    card = json.loads((folder / CARD).read_text())
    assert card["subjects"] == ["dog", "wolf"]
    assert card["identifiers"] == ["dog0", "dog1", "dog2", "wolf0", "wolf1", "wolf2"]
    before = (folder / CARD).stat().st_mtime_ns
    assert call(*train).splitlines() == [
        "nearest-view, tosca-III",
        "finished before",
        f"the model in {folder} was finished before; delete the folder to train anew",
    ]
    assert (folder / CARD).stat().st_mtime_ns == before
    selection = (
        "-t",
        "III-view",
        "-m",
        "nearest-view",
        *LIGHT,
        "--results",
        tmp_path,
        "--data-root",
        root,
    )
    told = " ".join(call("run", *selection, "-j", 1).split())
    assert "Nearest View" in told
    assert (
        "Trained on the classes of: Nearest View (all shapes: 6 of 12 shapes). "
        "These shapes stay in the gallery" in told
    )
    assert call("plan", *selection).startswith("finished")
    (folder / CARD).write_text(json.dumps(card | {"digest": "0" * 64}))
    plan = call("plan", *selection)
    assert plan.startswith("stale")
    assert "the model tosca-III changed" in plan


def test_a_copy_of_a_learner_with_another_name_has_models_of_its_own(tmp_path):
    plugin = tmp_path / "own.py"
    plugin.write_text(LEARNER.read_text().replace('"nearest-view"', '"own-view"'))
    copy = select_one("own-view", [plugin]).create()
    original = select_one("nearest-view", [LEARNER]).create()
    assert copy.model_name == original.model_name
    models = tmp_path / "models"
    folder = folder_of_training(original, "tosca-III", models)
    folder.mkdir(parents=True)
    (folder / CARD).write_text("{}")
    assert has_model(original, "tosca-III", models)
    assert not has_model(copy, "tosca-III", models)
    assert folder_of_training(copy, "tosca-III", models) == models / "tosca-III" / "own-view-seed0"


def test_one_process_trains_into_a_folder(root, tmp_path):
    train = ("train", "nearest-view", "-t", "III", "--results", tmp_path, "--data-root", root)
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    folder.parent.mkdir(parents=True)
    with (folder.parent / ".nearest-view-seed0.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        told = " ".join(call(*train, code=2).split())
    assert f"another training is writing to {folder}; wait for its end" in told
    assert call(*train).endswith(f"the model is in {folder}\n")
    assert [path.name for path in folder.parent.iterdir()] == ["nearest-view-seed0"]


@pytest.mark.parametrize("is_made_anew", [False, True])
def test_the_lock_of_a_training_that_ends_meanwhile_is_not_taken(
    tmp_path, monkeypatch, is_made_anew
):
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    lock = folder.with_name(".nearest-view-seed0.lock")

    def lock_too_late(descriptor, *, refusal):
        lock.unlink()  # by the process that had it
        if is_made_anew:
            lock.touch()  # by a third one
        take_lock(descriptor, refusal=refusal)

    monkeypatch.setattr("benchmark.commands.train.take_lock", lock_too_late)
    with pytest.raises(StorageError, match="has just ended"), _only_training_of(folder):
        pytest.fail("two processes train")


def test_a_training_whose_folders_are_removed_says_so_itself(tmp_path):
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    with pytest.raises(TrainingError, match="no place"), _only_training_of(folder):
        shutil.rmtree(tmp_path / "models")
        raise TrainingError("no place for a checkpoint")


def test_a_folder_that_cannot_be_made_is_named_before_data_are_read(root, tmp_path):
    (tmp_path / "models").write_text("a file")
    train = ("train", "nearest-view", "-t", "III", "--results", tmp_path, "--data-root", root)
    told = " ".join(call(*train, code=2).split())
    assert "models/tosca-III/nearest-view-seed0: Not a directory; free some space" in told
    assert "pairs" not in told


def test_a_refused_training_leaves_no_folder(root, tmp_path):
    train = ("train", "nearest-view", "-t", "III", "--results", tmp_path / "results")
    call(*train, "--data-root", root, "-o", "pairs=none", code=2)
    assert not (tmp_path / "results").exists()


def test_without_a_model_the_plan_names_the_command_that_trains_it(root, tmp_path, in_this_process):
    folders = ("--results", tmp_path, "--data-root", root)
    selection = ("-t", "III-view", "-m", "nearest-view[training_seed=1]", *LIGHT, *folders)
    told = call("plan", *selection)
    assert "unavailable  tosca view nearest-view[training_seed=1] by light" in told
    command = shlex.split(told.split("`")[1])
    assert command[3:7] == ["train", "nearest-view[training_seed=1]", "--table", "tosca-III"]
    call("run", *selection, "-j", "0", code=1)
    call(*command[3:-2], *folders)
    assert "2 of 2 jobs to run" in call("plan", *selection)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ([None, None], "it is not known how long that takes"),
        ([0.2], "about 1 s of processor time"),
        ([40.0, 59.0], "about 2 min of processor time"),
        ([40.0, None], "about 40 s of processor time for 1 of them; it is not known how long"),
    ],
)
def test_the_time_of_trainings_is_only_said_if_a_method_says_it(seconds, words):
    assert _duration_of_trainings(seconds).startswith(words)


def test_a_run_trains_what_it_lacks_first(root, tmp_path, in_this_process):
    folders = ("--results", tmp_path, "--data-root", root)
    selection = ("-t", "III-view", "-m", "nearest-view", *LIGHT, *folders)
    missing = "1 model is missing (1 of nearest-view); 'run --train' trains first"
    assert missing in call("plan", *selection)
    told = call("run", *selection, "-j", 1, "--train")
    assert missing in told and "training 1 of 1: nearest-view, tosca-III" in told
    assert "Nearest View" in told
    assert (tmp_path / "models" / "tosca-III" / "nearest-view-seed0" / CARD).is_file()
    assert missing not in call("plan", *selection)
    assert "training" not in call("run", *selection, "-j", 1, "--train").splitlines()[0]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("pass", r"there is no model of 'tosca-III': .*card\.json: No such file or directory"),
        ("raise SystemExit(0)", r"'nearest-view' failed: own\.py:\d+: SystemExit: 0"),
        ("{}['a']", r"'nearest-view' failed: own\.py:\d+: KeyError: 'a'"),
        ("raise MemoryError", r"'nearest-view' failed: own\.py:\d+: MemoryError"),
        (
            "folder.mkdir(parents=True); (folder / CARD).write_text('{}')",
            r"there is no model of 'tosca-III': .*card.json: not a readable card .*`digest`",
        ),
        (
            "data = replace(data, name='animals-III')",
            r"there is no model of 'tosca-III': .* was trained on 'animals-III'",
        ),
    ],
)
def test_a_training_that_leaves_no_model_is_an_error_that_says_why(root, tmp_path, line, reason):
    plugin = tmp_path / "own.py"
    begin = '        """Store all pairs at a lower resolution'
    text = LEARNER.read_text()
    assert text.count(begin) == 1
    text = text.replace(begin, f"        {line}\n{begin}")
    if not line.startswith("data"):
        text = text.replace("        if options:", "        return\n        if options:")
    plugin.write_text(text)
    folders = ("--results", tmp_path, "--data-root", root)
    told = verbs.refusal("train", "nearest-view", "-t", "III", *folders, "--plugin", plugin)
    assert re.search(reason, told), told
    assert told.endswith(f"'python -m benchmark check {plugin}' tests what a learner has to do")


def test_a_damaged_model_is_named_before_a_training_takes_it_for_finished(root, tmp_path):
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    folder.mkdir(parents=True)
    (folder / CARD).write_text("{")
    train = ("train", "nearest-view", "-t", "III", "--results", tmp_path, "--data-root", root)
    told = call(*train, code=2)
    assert f"there is no model of 'tosca-III': {folder}" in told
    assert told.endswith("; delete the folder to train anew")


def test_a_finished_model_for_other_test_subjects_is_named_by_training_and_run(root, tmp_path):
    of_own = ("train", "nearest-view", "--data", root / "tosca", "--results", tmp_path)
    call(*of_own, "--hold-out", "cat")
    folder = tmp_path / "models" / "own-tosca" / "nearest-view-seed0"
    told = call(*of_own, "--hold-out", "dog", code=2)
    reason = f"the model in {folder} was trained for other test subjects"
    assert told.endswith(f"{reason}; delete the folder to train anew")
    assert "finished before" in call(*of_own, "--hold-out", "cat")

    folders = ("--results", tmp_path, "--data-root", root)
    of_table = ("train", "nearest-view", "-t", "III", *folders)
    call(*of_table)
    folder = tmp_path / "models" / "tosca-III" / "nearest-view-seed0"
    card = json.loads((folder / CARD).read_text())
    (folder / CARD).write_text(json.dumps(card | {"tested": "0" * 64}))
    reason = f"the model in {folder} was trained for other test subjects"
    assert reason in call(*of_table, code=2)
    assert reason in call("plan", "-t", "III-view", "-m", "nearest-view", *LIGHT, *folders)


def test_a_training_that_fails_ends_the_run(root, tmp_path):
    folder = tmp_path / "models" / "tosca-III"
    folder.mkdir(parents=True)
    (folder / "nearest-view-seed0").write_text("no folder")
    selection = ("-t", "III-view", "-m", "nearest-view", *LIGHT, "--results", tmp_path)
    told = call("run", *selection, "--data-root", root, "-j", 1, "--train", code=2)
    assert "the training of nearest-view on 'tosca-III' failed" in told
    assert "run it alone: python -m benchmark train nearest-view -t tosca-III" in told
