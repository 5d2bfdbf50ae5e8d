"""Scorers by name, with parameters, and from plugin files; what they return is looked at."""

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.api.scoring import Scorer
from benchmark.cli.main import cli
from benchmark.errors import ConfigurationError, InvalidSignature
from benchmark.plugins.inspection import describe
from benchmark.plugins.output_checks import form_distances, signature_of
from benchmark.plugins.registry import plugin_methods
from benchmark.plugins.scorers import BUILT_IN, ScorerSpec, plugin_scorers, scorer_of, scorers
from tests.toy import rod, write_rods

PLUGIN = '''
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from benchmark.api.contracts import Interval
from benchmark.api.scoring import ScorerInfo


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Sizes along the principal axes."""

    info: ClassVar[ScorerInfo] = ScorerInfo(name="extent", title="Extent", summary="sizes", draws=2)
    power: Annotated[float, Interval(0, 3)] = 1.0

    def signature(self, form):
        centred = form.vertices - form.vertices.mean(axis=0)
        return {"sizes": np.linalg.svd(centred / np.linalg.norm(centred), compute_uv=False)}

    def compare(self, signatures, draw):
        rows = np.array([each["sizes"] for each in signatures])
        return np.linalg.norm(rows[:, None] - rows[None], axis=2) ** self.power
'''


@pytest.fixture
def plugin(tmp_path):
    path = tmp_path / "extent.py"
    path.write_text(PLUGIN)
    return path


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_scorers_keep_the_contract(name):
    scorer = scorer_of(name, scorers()).create()
    assert isinstance(scorer, Scorer)
    assert scorer.info.name == name
    signatures = [signature_of(scorer, rod(radius, 0.5, rings=8, sides=6)) for radius in (0.1, 0.2, 0.1)]
    matrix = form_distances(scorer, signatures, 0)
    assert matrix[0, 2] == 0 < matrix[0, 1] == matrix[1, 0]


def test_a_name_with_parameters_has_one_spelling_and_wrong_ones_are_refused():
    spec = scorer_of("cm-bof[n_words=8,subdivisions=2]", scorers())
    assert spec.name == "cm-bof[n_words=8]"
    assert spec.create().n_words == 8
    for wrong, said in (("shells", "unknown scorer"), ("cm-bof[subdivisions=9]", "subdivisions")):
        with pytest.raises(ConfigurationError, match=said):
            scorer_of(wrong, scorers())


def test_a_plugin_file_may_hold_a_scorer_alone(plugin):
    assert plugin_methods(plugin) == []
    (spec,) = plugin_scorers(plugin)
    assert scorer_of("extent[power=2]", scorers([plugin])).create().power == 2
    (facts,) = describe(str(plugin))
    assert (facts["kind"], facts["info"]["name"], facts["info"]["title"]) == ("scorer", "extent", "Extent")
    assert facts["all_parameters"] == {"power": 1.0}
    assert spec.name in CliRunner().invoke(cli, ["list", "scorers", "--plugin", str(plugin)]).output


def test_a_scorer_that_takes_a_name_or_says_what_cannot_be_is_refused(plugin):
    plugin.write_text(PLUGIN.replace('"extent"', '"cm-bof"'))
    with pytest.raises(ConfigurationError, match="two scorers are called 'cm-bof'"):
        scorers([plugin])


@pytest.mark.parametrize(
    "answer", [np.zeros(3), {}, {"a b": np.zeros(3)}, {"a": [1.0]}, {"a": np.array([np.nan])}, {"refused": np.zeros(3)}]
)
def test_what_is_no_signature_is_the_fault_of_the_scorer(plugin, answer, monkeypatch):
    (spec,) = plugin_scorers(plugin)
    monkeypatch.setattr(spec.load(), "signature", lambda self, form: answer)
    with pytest.raises(InvalidSignature, match="scorer 'extent' returned"):
        signature_of(spec.create(), rod(0.1, 0.5))


@pytest.mark.slow
def test_a_scorer_of_a_plugin_file_ranks_forms_and_leaves_descriptors_alone(plugin, tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    options = [
        "-d",
        str(rods),
        "-m",
        "gps",
        "-m",
        "surface-area",
        "--input",
        "mesh",
        "--results",
        str(tmp_path / "r"),
    ]
    by = ["--scorer", "extent", "--plugin", str(plugin)]
    done = CliRunner().invoke(cli, ["run", *options, *by, "-j", "0"])
    assert done.exit_code == 0, done.output
    assert "scored by Extent" in done.output
    assert "Surface area" in done.output
    planned = CliRunner().invoke(cli, ["plan", *options]).output
    # The descriptor is done whatever the scorer; the form is yet to be scored by the default one.
    assert "cached       rods mesh surface-area" in planned
    assert "missing      rods mesh gps" in planned


@pytest.mark.parametrize("raised", ["RuntimeError('no licence')", "SystemExit('no licence')"])
def test_a_package_that_ends_its_import_is_named(tmp_path, monkeypatch, raised):
    (tmp_path / "ending_scorer.py").write_text(f"raise {raised}")
    monkeypatch.syspath_prepend(tmp_path)
    said = "scorer 'mine' cannot be imported: .*no licence; repair ending_scorer"
    with pytest.raises(ConfigurationError, match=said):
        ScorerSpec("mine", "ending_scorer:Mine").load()
