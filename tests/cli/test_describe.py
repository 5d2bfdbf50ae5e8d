"""What is told of a method before it is run."""

import json

import pytest
from click.testing import CliRunner

from benchmark.cli.main import cli
from benchmark.methods.registry import BUILT_IN, methods
from benchmark.reference.bibliography import source_of


def call(*arguments, code=0):
    done = CliRunner().invoke(cli, list(map(str, arguments)))
    assert done.exit_code == code, (done.output, done.exception)
    return done.output


def test_a_method_is_described_with_parameters_source_and_inputs():
    said = call("describe", "classic-mds[metric=biharmonic]")
    assert said.startswith("classic-mds[metric=biharmonic]: Classic MDS\n")
    told = " ".join(said.split())
    assert "source Asi Elad and Ron Kimmel (2003). On Bending Invariant Signatures for Surfaces. IEEE" in told
    assert "inputs mesh and view" in told
    assert "metric geodesic or diffusion or commute-time or biharmonic; default geodesic, here biharmonic" in told
    assert "time a number above 0; default 0.05 Time of the diffusion, in units of the area of the surface." in told


def test_other_programs_get_the_same_as_json():
    facts = json.loads(call("describe", "gps", "--json"))
    assert (facts["name"], facts["inputs"], facts["parameters"]) == ("gps", ["mesh", "view"], [])
    assert facts["kind"] == "method"
    assert json.loads(call("describe", "shape-dna", "--json"))["kind"] == "descriptor"
    assert json.loads(call("describe", "learned", "--json"))["kind"] == "learner"


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_source_is_told_as_text(name):
    cite = methods()[name].info.cite
    told = source_of(cite)
    assert (told != cite) or not cite
    assert not set("\\{}") & set(told)


def test_accents_and_missing_entries():
    assert source_of("sahillioglu2015constrained").startswith("Yusuf Sahillioğlu (2015). A Shape Deformation")
    assert source_of("nobody1900") == "nobody1900"
    assert source_of("") == ""
