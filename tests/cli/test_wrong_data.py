"""What is said of data that is not where, or not what, the command line says."""

import pytest
from typer.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from tests.toy import write_rods


def call(*words):
    return CliRunner().invoke(cli, list(map(str, words)))


@pytest.mark.parametrize(("place", "right"), [("sets/tosca", "sets"), (".", "sets"), ("sets", ""), ("other/a", "")])
def test_a_wrong_data_root_is_refused_with_the_right_one(tmp_path, place, right):
    (tmp_path / "sets" / "tosca").mkdir(parents=True)
    (tmp_path / "other" / "a" / "b").mkdir(parents=True)
    error = call("list", "datasets", "--data-root", tmp_path / place).exception
    if not right:
        assert error is None
        return
    assert isinstance(error, ConfigurationError)
    assert "holds no official data set" in error.problem
    assert error.hint == f"pass --data-root {tmp_path / right}"


def test_a_run_says_which_files_it_skips(tmp_path):
    write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    (tmp_path / "rods" / "scan.glb").touch()
    words = ("-d", tmp_path / "rods", "-m", "surface-area", "--input", "mesh", "--results", tmp_path / "results")
    assert "skipped scan.glb: formats that are not read" in call("run", *words).output
    assert "scan.glb  is skipped: this format is not read" in call("data", "check", tmp_path / "rods").output


def test_a_stand_in_is_announced_before_the_run(tmp_path, monkeypatch):
    monkeypatch.delenv("CANONICAL_FORMS_DATA", raising=False)
    words = ("-t", "III", "-m", "learned", "--input", "mesh", "--results", tmp_path)  # which runs nothing
    assert call("run", *words).output.startswith("animals: generated stand-in for tosca, which is not at DATA_ROOT")
    (tmp_path / "data" / "tosca").mkdir(parents=True)  # there, though not asked for
    words = ("-d", "animals", *words[2:], "--data-root", tmp_path / "data")
    assert call("run", *words).output.startswith("animals: generated stand-in for tosca\n")


def test_a_long_plan_fits_on_a_screen(tmp_path):
    lines = call("plan", "-t", "III", "--results", tmp_path).output.splitlines()
    assert len(lines) < 24
    assert lines[0].startswith("III mesh  ")


def test_a_figure_takes_the_place_of_a_figure_alone(tmp_path):
    target, words = tmp_path / "cost.png", ("report", "--published", "-t", "III", "--of", "cost", "--figure")
    target.write_bytes(b"somebody's own")
    assert "was not drawn by 'report'" in call(*words, target).exception.problem
    assert call(*words, target, "--force").exit_code == 0
    assert call(*words, target).exit_code == 0
    assert target.read_bytes().startswith(b"\x89PNG")
