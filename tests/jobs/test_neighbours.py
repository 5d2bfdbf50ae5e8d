"""Jobs that look for the nearest shapes alone: from the command line to the table."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError
from benchmark.jobs import retrieval
from benchmark.jobs.job_specs import from_json, to_json
from benchmark.methods.scorers import scorer_of, scorers
from benchmark.results import open_results
from benchmark.storage.store import Store
from retrieval.clock_index import ClockIndex
from tests.toy import write_rods

PLUGIN = ("--plugin", str(Path(__file__).parents[2] / "examples" / "distance_distribution.py"), "--neighbours", "5")


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A folder in which five rods were run with two neighbours, and with all pairs."""
    folder = tmp_path_factory.mktemp("neighbours")
    rods = write_rods(folder / "rods", bends=(0.0, 1.2))
    words = ["-d", str(rods), "-m", "identity", "--input", "mesh", "--results", str(folder / "results")]
    for more in ([], ["--neighbours", "2"]):
        done = CliRunner().invoke(cli, ["run", *words, "--executor", "serial", *more])
        assert done.exit_code == 0, done.output
    return words, Store.open(folder / "results")


def told(words, *more):
    done = CliRunner().invoke(cli, [*more[:1], *words, *more[1:]])
    assert done.exit_code == 0, done.output
    return done.output


def test_a_record_says_how_many_neighbours_it_looked_for(ran):
    exact, found = sorted(ran[1].records, key=lambda record: "neighbours" in record)
    assert found["neighbours"] == 2 and found["scorer"] == "cm-bof[neighbours=2]"
    assert found["scores"].keys() == {"NN", "P@K"} == found["per_query"].keys()
    assert found["scores"]["NN"] == exact["scores"]["NN"]
    assert found["recipe"]["scorer"]["neighbours"] == 2 and found["key"] != exact["key"]
    assert found["digests"]["signatures"] == exact["digests"]["signatures"]
    assert found["cost"]["seconds_per_shape"].keys() == exact["cost"]["seconds_per_shape"].keys()


def test_tables_keep_it_apart_and_say_so(ran):
    words, _ = ran
    exact = told(words, "tables")
    assert "P@K" not in exact and "--" not in exact.splitlines()[4]
    assert told(words, "tables", "--neighbours", "2") == told(words, "tables", "--scorer", "cm-bof[neighbours=2]")
    found = told(words, "tables", "--neighbours", "2")
    assert "scored by CM-BOF (neighbours=2)" in found and "The 2 nearest shapes of each query" in found
    line = next(line for line in found.splitlines() if line.startswith("| Identity"))
    assert [cell.strip() for cell in line.split("|")[3:6]] == ["--"] * 3
    (row,) = json.loads(told(words, "tables", "--neighbours", "2", "--format", "json"))
    assert row["FT"] is None and row["neighbours"] == 2 and 0 < row["P@K"] < 1
    head, body = told(words, "tables", "--neighbours", "2", "--format", "csv").splitlines()
    assert head.endswith(",P@K,low_P@K,high_P@K,p_best_P@K,spread_P@K,neighbours") and body.endswith(",2")


def test_more_neighbours_come_from_the_same_index(ran, monkeypatch):
    words, _ = ran
    monkeypatch.setattr(ClockIndex, "of", lambda *_: pytest.fail("an index was made"))
    found = told(words, "run", "--neighbours", "3", "--executor", "serial")
    assert "by cm-bof[neighbours=3]  NN" in found


def test_a_plan_and_a_worker_know_it(ran):
    words, store = ran
    assert "finished" in told(words, "plan", "--neighbours", "2")
    spec = scorer_of("cm-bof[n_words=900,neighbours=7]", scorers())
    assert (spec.neighbours, spec.name) == (7, "cm-bof[n_words=900,neighbours=7]")
    assert from_json(to_json(spec)) == spec
    results = open_results(store.root.parent)
    key = next(record["key"] for record in store.records if record.get("neighbours") == 2)
    assert results.records().loc[key, "P@K"] > 0
    with pytest.raises(ConfigurationError, match="looked for 2 neighbours"):
        results.distances(key)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--neighbours", "0"], "0 is not in the range x>=1"),
        (["--scorer", "cm-bof[neighbours=0]"], "neighbours=0 is no number of shapes"),
        (["--scorer", "cm-bof[neighbours=some]"], "neighbours=some is no number of shapes"),
        (["--scorer", "cm-bof[allow_mirror=true]", "--neighbours", "5"], "has no vectors to find neighbours by"),
        (["--scorer", "distance-distribution", *PLUGIN], "scorer 'distance-distribution' has no vectors"),
    ],
)
def test_what_cannot_be_is_refused_by_name(ran, more, said):
    done = CliRunner().invoke(cli, ["run", *ran[0], *more])
    assert done.exit_code != 0
    assert said in done.output + str(done.exception)


def test_a_report_needs_whole_rankings(ran):
    done = CliRunner().invoke(cli, ["report", *ran[0], "--neighbours", "2"])
    assert "a report shows whole rankings" in str(done.exception)


def test_retrieve_of_a_large_gallery_reads_the_index_of_the_run(ran, monkeypatch):
    words, _ = ran
    folder = words[words.index("-d") + 1]
    asked = ["retrieve", *words[:4], *words[6:], f"{folder}/thin1.off", "-k", "4"]
    monkeypatch.setattr("benchmark.system.calls.call_apart", lambda work, *given, guard: work(*given))
    exact = CliRunner().invoke(cli, asked).output.splitlines()
    monkeypatch.setattr(retrieval, "LARGE", 3)
    monkeypatch.setattr(ClockIndex, "of", lambda *_: pytest.fail("an index was made"))
    found = CliRunner().invoke(cli, asked).output.splitlines()
    assert found[-1].split(";")[1].startswith(" 3 of 4 forms compared, ")
    assert [line.split()[1] for line in found[1:4]] == [line.split()[1] for line in exact[1:4]]
    assert "thin1" not in " ".join(found[1:-1])
