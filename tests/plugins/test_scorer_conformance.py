"""A right scorer passes, and each fault of one is found by the check that is made for it."""

from pathlib import Path

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import conformance
from benchmark.plugins.conformance import checks
from tests.plugins.test_conformance import call_here

RETURN = 'return cdist(shares, shares, "cityblock")'

EXAMPLE = Path(__file__).parents[2] / "examples" / "distance_distribution.py"


@pytest.fixture
def findings(tmp_path, monkeypatch):
    """What is found in the example of a scorer, after an edit."""
    monkeypatch.setattr(checks, "call_apart", call_here)
    monkeypatch.setattr(checks, "hide_data", lambda: None)  # it would be hidden from all further tests
    source = EXAMPLE.read_text()

    def check(old="", new=""):
        assert old in source
        path = tmp_path / f"scorer_{abs(hash((old, new)))}.py"
        path.write_text(
            "import itertools\nCALLS = itertools.count()\n" + source.replace("from __future__", "#").replace(old, new)
        )
        (found,) = conformance.check_target(str(path)).findings.values()
        return {finding.name: finding for finding in found}

    return check


def test_a_right_scorer_passes(findings):
    assert {found.outcome for found in findings("bins: ", "bins: ").values()} == {"ok"}


@pytest.mark.parametrize(
    ("old", "new", "check", "message"),
    [
        ("frozen=True, ", "", "class", "parameters can be changed after creation"),
        (
            'return {"shares": counts / weights.sum()}',
            "return counts",
            "signature",
            "returned ndarray, not named arrays",
        ),
        ('{"shares": counts / weights.sum()}', '{"shares": counts * np.nan}', "signature", "finite numbers"),
        (RETURN, "return shares", "dissimilarities", "returned an array of shape (6, 64)"),
        (RETURN, "return np.triu(cdist(shares, shares))", "dissimilarities", "symmetric"),
        ('"cityblock")', '"cityblock") * 0.0', "dissimilarities", "tells no two of 6 signatures apart"),
        (
            "counts / weights.sum()}",
            "counts / weights.sum() + next(CALLS)}",
            "repeatable",
            "differ by",
        ),
        ("distances / mean", "distances", "motion", "depends on position or size"),
        ("counts / weights.sum()}", "counts / weights.sum() + abs(form.vertices[0, 0])}", "relabelling", "numbering"),
        ("if not mean > 0:", "if 1 / mean < 0:", "awkward forms", "a point"),
    ],
)
def test_a_fault_is_found_by_its_check(findings, old, new, check, message):
    found = findings(old, new)
    assert found[check].outcome == "failed", found[check]
    assert message in found[check].explanation


def test_a_scorer_is_checked_by_name_and_with_parameters(tmp_path):
    target = conformance.Target("distance-distribution[bins=8]", plugins=(str(EXAMPLE),))
    assert [(spec.kind, spec.name) for spec in target.specs()] == [("scorer", "distance-distribution[bins=8]")]
    assert [(spec.kind, spec.name) for spec in conformance.Target("cm-bof").specs()] == [("scorer", "cm-bof")]
    with pytest.raises(ConfigurationError, match="write a whole number of at least 2"):
        conformance.Target("distance-distribution[bins=1]", plugins=(str(EXAMPLE),)).specs()
