"""A right scorer passes, and each fault of one is found by the check that is made for it."""

import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import conformance
from tests.plugins.conftest import EXAMPLES

RETURN = 'return cdist(shares, shares, "cityblock")'

EXAMPLE = EXAMPLES / "distance_distribution.py"


#: What an edit may use.
BEFORE = "import itertools\nCALLS = itertools.count()\n"


def test_a_right_scorer_passes(findings_in):
    assert {found.outcome for found in findings_in(EXAMPLE.name, "bins: ", "bins: ", BEFORE).values()} == {"ok"}


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
        ('"cityblock")', '"cityblock") * 0.0', "dissimilarities", "does not distinguish any of 6 signatures"),
        ("counts / weights.sum()}", "counts / weights.sum() + next(CALLS)}", "repeatable", "differ by"),
        ("distances / mean", "distances", "motion", "depends on position or size"),
        ("counts / weights.sum()}", "counts / weights.sum() + abs(form.vertices[0, 0])}", "relabelling", "numbering"),
        ("if not mean > 0:", "if 1 / mean < 0:", "awkward forms", "a point"),
    ],
)
def test_a_fault_is_found_by_its_check(findings_in, old, new, check, message):
    found = findings_in(EXAMPLE.name, old, new, BEFORE)
    assert found[check].outcome == "failed", found[check]
    assert message in found[check].explanation


def test_a_scorer_is_checked_by_name_and_with_parameters(tmp_path):
    target = conformance.Target("distance-distribution[bins=8]", plugins=(EXAMPLE,))
    assert [(spec.kind, spec.name) for spec in target.specs()] == [("scorer", "distance-distribution[bins=8]")]
    assert [(spec.kind, spec.name) for spec in conformance.Target("cm-bof").specs()] == [("scorer", "cm-bof")]
    with pytest.raises(ConfigurationError, match="write a whole number of at least 2"):
        conformance.Target("distance-distribution[bins=1]", plugins=(EXAMPLE,)).specs()
