"""Forged records with right checksums: each is named or gives its own figures, and none ends a
verb.
"""

from __future__ import annotations

import pytest

from tests.forge import Workshop, finding, forge


def test_a_forged_record_is_refused_with_a_reason_or_has_the_means_of_its_values():
    found = [finding(text) for _, text in forge(seed=3, count=100)]
    assert "" not in found
    assert 10 < found.count("used") < 90


@pytest.mark.slow
def test_forged_records_end_no_verb(tmp_path):
    forged = [text for _, text in forge(seed=4, count=25)]
    assert [*Workshop(tmp_path).faults(forged)] == []
