"""Names that a shell completes."""

import subprocess

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli, main


@pytest.fixture
def words(monkeypatch, capsys):
    """What a shell is offered behind some words, the last of which is begun."""

    def ask(*line):
        monkeypatch.setenv("COMP_WORDS", " ".join(("canonical-forms", *line)))
        monkeypatch.setenv("COMP_CWORD", str(len(line)))
        monkeypatch.setenv("_CANONICAL_FORMS_COMPLETE", "bash_complete")
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 0
        return [tuple(row.split(",", 1)) for row in capsys.readouterr().out.split()]

    return ask


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        (("run", "-m", "class"), [("plain", "classic-mds")]),
        (("tables", "-m", "fin"), [("plain", "finished")]),
        (("describe", "gp"), [("plain", "gps")]),
        (("why", "shape-d"), [("plain", "shape-dna")]),
        (("canonicalise", "-m", "skel"), [("plain", "skeleton")]),
        (("train", "learned-wide"), [("plain", "learned-wide-extra")]),
        (("run", "--scorer", "cm"), [("plain", "cm-bof")]),
        (("run", "-t", "III"), [("plain", "III"), ("plain", "III-held-out")]),
        (("run", "-d", "tos"), [("plain", "tosca"), ("dir", "tos")]),
        (("data", "sheet", "humans-s"), [("plain", "humans-scanlike"), ("dir", "humans-s")]),
        (("run", "-m", "classic-mds[metric=gps,sol"), [("plain", "classic-mds[metric=gps,solver=")]),
        (("check", "mine"), [("file", "mine")]),
        (("desc",), [("plain", "describe")]),
        (("describe", "no-such"), []),
    ],
)
def test_names_are_offered(words, line, offered):
    assert words(*line) == offered


def test_bash_reads_the_script():
    text = CliRunner().invoke(cli, ["completion", "bash"]).output
    assert "complete" in text
    assert subprocess.run(["bash", "-n"], input=text, text=True, check=False, capture_output=True).returncode == 0
