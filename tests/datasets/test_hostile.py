"""Lists, settings and names that no data set should have: a named error before any work, or one shape that is lost."""

import os
import re
import sys

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.datasets.checking import check, check_source
from benchmark.datasets.folder import folder_set
from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh
from benchmark.geometry.mesh import Mesh
from tests.toy import rod, write_off, write_rods


@pytest.fixture
def rods(tmp_path):
    return write_rods(tmp_path / "rods")


def refused(folder, message):
    """The same problem is named by the loader, the check, the plan and the run, and nothing else comes out."""
    with pytest.raises(BenchmarkError, match=message) as caught:
        folder_set(folder)
    assert caught.value.hint
    report = check_source(str(folder), None)
    assert not report.usable
    assert any(caught.value.problem in str(anomaly) for anomaly in report.anomalies)
    for verb in (["data", "check"], ["plan", "-m", "identity", "-d"], ["run", "-m", "identity", "-d"]):
        extra = [] if verb[0] == "data" else ["--results", str(folder.parent / "results")]
        done = CliRunner().invoke(cli, [*verb, str(folder), *extra])
        # What is no problem that the user can correct would leave the program as a traceback.
        assert isinstance(done.exception, (SystemExit, BenchmarkError)), done.output
        assert done.exit_code != 0


@pytest.mark.parametrize("name", ["dataset.toml", "classes.cla"])
def test_a_list_that_is_no_file_is_named(rods, name):
    (rods / name).symlink_to("nowhere")
    refused(rods, f"{name} is no file, or a link that leads nowhere")
    (rods / name).unlink()
    (rods / name).mkdir()
    refused(rods, f"{name} is no file")


@pytest.mark.parametrize(
    "text",
    [
        "half_width = 1" + "0" * 400,
        "half_width = " + "9" * 5000,
        "half_width = " + "[" * 5000,
        "camera = { direction = [1" + "0" * 400 + ", 0, 0] }",
    ],
    ids=["too large", "digits", "brackets", "direction"],
)
def test_hostile_settings_are_named(rods, text):
    (rods / "dataset.toml").write_text(text)
    refused(rods, "dataset.toml")


@pytest.mark.parametrize("word", ["1_0", "-1", "٣", "9" * 5000, "0x1"])
def test_a_number_in_a_cla_file_is_of_ascii_digits(tmp_path, word):
    write_off(tmp_path / "0.off", rod(0.1, 0.0))
    (tmp_path / "x.cla").write_text(f"PSB 1\n1 1\n\na 0 {word}\n0\n")
    with pytest.raises(DatasetError, match="is not a whole number; expected '<name>"):
        folder_set(tmp_path)


def test_a_link_that_leads_nowhere_costs_its_shape(rods):
    (rods / "thin9.off").symlink_to("nowhere.off")
    dataset = folder_set(rods)
    (lost,) = (entry for entry in dataset.shapes if entry.identifier == "thin9")
    with pytest.raises(UnreadableMesh, match=r"thin9\.off: No such file"):
        dataset.load(lost)
    (anomaly,) = check(dataset).anomalies
    assert str(anomaly).startswith("error    thin9.off  No such file or directory; check the path")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such names")
def test_names_that_cannot_be_printed_are_written_so_that_they_can(rods):
    raw = os.fsencode(rods)
    (rods / "thin0.off").rename(rods / "thin\n0.off")
    (rods / "thin1.off").rename(rods / "thin\x1b[31m1.off")
    os.rename(raw + b"/thin2.off", raw + b"/thin\xff2.off")  # noqa: PTH104
    entries = {entry.identifier: entry for entry in folder_set(rods).shapes}
    assert {r"thin\n0", r"thin\x1b[31m1", r"thin\udcff2"} <= entries.keys()
    assert entries[r"thin\n0"].subject == r"thin\n"
    for entry in entries.values():
        for text in (entry.identifier, entry.subject, entry.pose):
            assert text.isprintable()
            text.encode("utf-8")
        assert folder_set(rods).load(entry).n_vertices == 290
    (rods / r"thin\n0.off").write_bytes((rods / "thin\n0.off").read_bytes())
    with pytest.raises(DatasetError, match="two shapes that are both written"):
        folder_set(rods)


# Shapes out of scale


ANOMALIES = {
    "line": "error    thin7.off  no face has an area",
    "tiny": "error    thin7.off  the bounding box of the mesh has extent",
    "small": "warning  thin7.off  extends to .*, almost nothing in a frame",
    "spike": "warning  thin7.off  extends to .*, out of scale with the others",
}


def out_of_scale(what):
    vertices = {"large": 1e5, "huge": 1e160, "small": 1e-5, "tiny": 1e-160}.get(what, 1.0) * rod(0.1, 0.7).vertices
    if what == "line":
        vertices = vertices * [1, 0, 0]
    if what == "spike":
        vertices[7] *= 1e5
    return Mesh(vertices, rod(0.1, 0.7).faces)


@pytest.mark.parametrize("what", ANOMALIES)
def test_a_shape_out_of_scale_is_named_by_the_check(rods, what):
    write_off(rods / "thin7.off", out_of_scale(what))
    report = check_source(str(rods), None)
    anomalies = [anomaly for anomaly in report.anomalies if anomaly.file == "thin7.off"]
    assert any(re.match(ANOMALIES[what], str(anomaly)) for anomaly in anomalies), anomalies
    assert not [anomaly for anomaly in report.anomalies if anomaly.file != "thin7.off"]
