"""A learner without a model is trained on a few images, and checked with that."""

import pytest

from benchmark.plugins import conformance
from benchmark.plugins.registry import methods, variant


@pytest.mark.parametrize(
    ("old", "new", "check", "message"),
    [
        ('"seed{self.training_seed}"', '"a/b"', "learner", "model_name is 'a/b'"),
        ('] = "table"', '] = "tabel"', "learner", "split is 'tabel'; choose one of table, strict, sampled"),
        (
            '(folder / CARD).write_text(json.dumps(card), encoding="utf-8")',
            "pass",
            "training",
            "'train' ends without card.json; write it last",
        ),
        ('"subjects": data.subjects,', "", "training", "missing required field `subjects`"),
        ('"identifiers": data.identifiers,', '"identifiers": ["me"],', "training", "all identifiers"),
        ("return loaded", "return None", "training", "'load' returns NoneType"),
        ("hexdigest()", "hexdigest()[::-1]", "training", "has digest"),
    ],
)
def test_a_fault_of_a_learner_is_found_before_anybody_trains_it(old, new, check, message, findings_in):
    found = findings_in("nearest_view.py", old, new)
    assert found[check].outcome == "failed"
    assert message in found[check].explanation


def test_a_learner_that_says_where_its_model_lies_is_trained_only_if_asked(tmp_path):
    spec = variant("learned-without-srf[training=humans-strict-0-0]", methods())
    (finding,) = conformance.check(spec)
    assert finding.outcome == "skipped"
    assert "no model in humans-strict-0-0/without_srf-seed0" in finding.explanation
    assert "-o epochs=1" in finding.explanation
