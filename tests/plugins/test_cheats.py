"""Plugins that try to gain by what they must not touch or know: each gains nothing."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from tests.toy import write_rods

pytestmark = pytest.mark.slow

CHEATS = Path(__file__).with_name("cheats.py")
BENDS = (0.0, 0.4, 0.8, 1.2, 1.6, 2.0)
BUILT_IN = ("-m", "identity", "-m", "surface-area")


def run(folder, results, *arguments):
    options = ["run", "-d", str(folder / "rods"), "--input", "mesh", "--results", str(folder / results), "-j", "1"]
    done = CliRunner().invoke(cli, [*options, *map(str, arguments)])
    assert done.exit_code == 0, done.output
    found = (json.loads(path.read_text()) for path in (folder / results / "runs" / "records").glob("*.json"))
    return {record["method"]: record for record in found}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """Records of all cheats, and of methods of the suite that were run after them in the same folder."""
    folder = tmp_path_factory.mktemp("cheats")
    write_rods(folder / "rods", BENDS)
    run(folder, "cheated", "--plugin", CHEATS, "-m", "patched-library")
    others = ("patched-measures", "named", "searching", "ordered", "names-guessed", "counting")
    (folder / "file").write_text("at first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CHEAT_FILE", str(folder / "file"))
        run(folder, "cheated", "--plugin", CHEATS, *(word for name in others for word in ("-m", name)))
    return run(folder, "cheated", *BUILT_IN), run(folder, "clean", *BUILT_IN)


@pytest.mark.parametrize("method", ["identity", "surface-area"])
def test_a_patched_library_changes_no_other_row(records, method):
    cheated, clean = (each[method] for each in records)
    assert cheated["digests"] == clean["digests"]
    assert cheated["per_query"] == clean["per_query"]


def test_patched_measures_change_no_score(records):
    cheated, clean = records
    for method in ("patched-library", "patched-measures"):
        assert cheated[method]["scores"] == clean["identity"]["scores"]
    assert clean["identity"]["scores"]["FT"] < 1


def test_a_method_is_told_no_name_and_draws_numbers_that_no_name_gives(records):
    notes = records[0]["named"]["notes"]
    assert all(name.isdecimal() for name in notes["name"])
    assert len(notes["name"]) == 2 * len(BENDS)
    names = [f"{radius}{number}" for radius in ("thick", "thin") for number in range(len(BENDS))]
    by_name = [hashlib.sha256(f"0|{name}|x".encode()).digest() for name in names]
    drawn = [np.random.default_rng(int.from_bytes(digest[:8], "big")).random() for digest in by_name]
    assert notes["drawn"]["max"] != pytest.approx(np.max(drawn))


def test_names_are_not_guessed(records):
    assert records[0]["names-guessed"]["scores"]["NN"] < 0.75


def test_no_label_is_in_the_process_of_a_method(records):
    assert records[0]["searching"]["notes"]["found"] == {"mean": 0.0, "max": 0.0}


def test_places_in_the_gallery_tell_nothing(records):
    # By the places in the sorted gallery, all nearest neighbours but one would be of the right class.
    assert records[0]["ordered"]["scores"]["NN"] < 0.75
    assert records[0]["counting"]["scores"]["NN"] < 0.75
