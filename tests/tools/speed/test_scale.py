"""What the page on scale is made of: the ranking alone runs, and other sizes follow from those that were run."""

from __future__ import annotations

import pytest

from tools.speed import scale


def test_the_ranking_alone_is_measured() -> None:
    found = scale.ranking(40)
    assert found.keys() == scale.RANKING.keys()
    assert all(value > 0 for value in found.values())


@pytest.mark.parametrize(
    ("name", "low", "high", "expected"),
    [
        ("run_seconds", 100.0, 200.0, 400.0),  # a power: twice as many, twice as long
        ("tables_seconds", 1.0, 4.0, 16.0),
        ("ranking_peak_mib", 101.0, 104.0, 116.0),  # 100 + (n / 1000)^2
        ("disk_mib", 11.0, 24.0, 56.0),  # 10 (n / 1000) + (n / 1000)^2
    ],
)
def test_a_size_that_was_not_run_follows_from_two_that_were(
    name: str, low: float, high: float, expected: float
) -> None:
    measured = {"1000": {name: low}, "2000": {name: high}}
    assert scale.figure_of(measured, name, 2000) == (high, True)
    found = scale.figure_of(measured, name, 4000)
    assert found == (pytest.approx(expected), False)
    assert scale.figure_of({"1000": {name: low}}, name, 4000) is None


def test_the_page_marks_what_was_not_measured() -> None:
    page = scale.page({"1000": {"disk_mib": 11.0}, "2000": {"disk_mib": 24.0}})
    (line,) = [line for line in page.splitlines() if line.startswith("| disk at the end")]
    assert [cell.strip() for cell in line.split("|")[2:-1]] == ["≈ 1.01", "11", "24", "≈ 56", "≈ 200"]
