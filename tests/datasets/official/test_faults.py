"""Official sets that are not as they were given out: what is wrong is named, and costs no more than it must."""

import re

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import data
from benchmark.datasets.catalogue import open_dataset
from benchmark.datasets.checking import check_source
from benchmark.errors import DatasetError
from benchmark.protocols.galleries import galleries
from tests.datasets.official.faults import FAULTS, move, relist
from tests.datasets.official.layouts import class_of


@pytest.mark.parametrize("fault", FAULTS)
def test_a_set_that_is_not_as_it_was_given_out_is_named(damaged, tmp_path, fault):
    name, damage, message = FAULTS[fault]
    folder = damaged(name)
    damage(folder)
    with pytest.raises(DatasetError, match=message):
        open_dataset(name, tmp_path)


def test_the_list_may_be_called_categories(sets, damaged, tmp_path):
    relist(damaged("shrec11"), str, "categories.txt")
    labels = [entry.subject for entry in open_dataset("shrec11", tmp_path).shapes]
    assert labels == [entry.subject for entry in open_dataset("shrec11", sets).shapes]


def test_folders_of_classes_take_the_place_of_the_list(sets, damaged, tmp_path):
    folder = damaged("shrec11")
    (folder / "test.cla").unlink()
    for number in range(600):
        place = folder / "shrec_16" / f"beast{class_of(number, 30)}" / ("test" if number % 5 == 0 else "train")
        place.mkdir(parents=True, exist_ok=True)
        move(folder, f"T{number}.off", place / f"T{number}.off")
    dataset, listed = open_dataset("shrec11", tmp_path), open_dataset("shrec11", sets)
    assert [(e.identifier, e.subject) for e in dataset.shapes] == [(e.identifier, e.subject) for e in listed.shapes]
    # 31 and 1 are of one class; 32 is not.
    path = dataset.shapes[32].path
    path.rename(dataset.shapes[1].path.with_name("T32.off"))
    with pytest.raises(DatasetError, match="class 'beast[0-9]+' of .*shrec11 has (19|21) models, not the official 20"):
        open_dataset("shrec11", tmp_path)


def test_unreadable_files_cost_their_shapes_and_not_the_set(damaged, tmp_path):
    folder = damaged("kids")
    for file in ("0001.null.0.off", "0002.null.0.off"):
        (folder / file).unlink()
        (folder / file).touch()
    assert len(open_dataset("kids", tmp_path).shapes) == 32
    report = check_source("kids", tmp_path)
    assert [a.file for a in report.anomalies if a.severity == "error"] == ["0001.null.0.off", "0002.null.0.off"]


def test_a_set_of_one_subject_says_what_it_is_for(sets):
    done = CliRunner().invoke(data, ["check", "scape", "--data-root", str(sets)])
    assert done.exit_code == 0, done.output
    assert "data set 'scape' shows one subject, so nothing can be retrieved; use it with canonicalise" in done.output
    with pytest.raises(DatasetError, match="'topkids' shows one subject, so nothing can be retrieved; use it with"):
        galleries([], ["topkids"], sets)


@pytest.mark.parametrize("fault", ["a missing file"])
def test_the_check_names_what_is_wrong_and_still_reads_the_meshes(damaged, tmp_path, fault):
    name, damage, message = FAULTS[fault]
    damage(damaged(name))
    done = CliRunner().invoke(data, ["check", name, "--data-root", str(tmp_path)])
    assert done.exit_code == 1
    (error,) = [line for line in done.output.splitlines() if line.startswith("error")]
    assert re.search(message, error)
    assert "vertices    4 to 4" in done.output
