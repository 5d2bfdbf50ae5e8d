"""What the page on scale is made of: the ranking alone runs, and other sizes follow from those that were run."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmark.storage.records import Records
from tests.records import record
from tools.speed import _scale_page, scale


def test_the_ranking_alone_is_measured() -> None:
    found = scale.ranking(40)
    assert found.keys() == _scale_page.RANKING.keys()
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
    assert _scale_page.figure_of(measured, name, 2000) == (high, True)
    found = _scale_page.figure_of(measured, name, 4000)
    assert found == (pytest.approx(expected), False)
    assert _scale_page.figure_of({"1000": {name: low}}, name, 4000) is None


def test_inputs_that_were_run_apart_are_summed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    parts = {
        "mesh": {
            "run_seconds": 5.0,
            "ranking_seconds": 2.0,
            "disk_mib": 7.0,
            "peak_mib": 90.0,
            "most_disk_mib": 8.0,
            "plan_seconds": 1.0,
            "tables_seconds": 1.0,
            "stages": {"mesh gps": {}},
        },
        "view": {
            "run_seconds": 3.0,
            "ranking_seconds": 1.0,
            "disk_mib": 4.0,
            "peak_mib": 80.0,
            "most_disk_mib": 9.0,
            "plan_seconds": 1.0,
            "tables_seconds": 1.0,
            "stages": {"view gps": {}},
        },
    }
    asked = []
    monkeypatch.setattr(scale, "MEASURED", tmp_path / "scale.json")
    monkeypatch.setattr(scale, "run", lambda size, folder, input_: asked.append(input_) or parts[input_])
    first = scale.run_in_parts(40, tmp_path, "mesh")
    assert first == {"parts": {"mesh": parts["mesh"]}}
    (tmp_path / "scale.json").write_text(json.dumps({"40": first}))
    assert scale.run_in_parts(40, tmp_path, "mesh") == first  # not run again
    both = scale.run_in_parts(40, tmp_path, "view")
    assert asked == ["mesh", "view"]
    assert (both["run_seconds"], both["ranking_seconds"], both["disk_mib"]) == (8.0, 3.0, 11.0)
    assert (both["peak_mib"], both["most_disk_mib"]) == (90.0, 9.0)
    assert list(both["stages"]) == ["mesh gps", "view gps"]
    page = _scale_page.page({"100": both}).splitlines()
    (start,) = [k for k, line in enumerate(page) if line.startswith("Of 100 shapes, inputs were run apart")]
    assert page[start + 3 : start + 6 : 2] == ["|  | mesh | view |", "| run, wall seconds on 2 cores | 5 | 3 |"]


def test_what_a_stopped_run_took_counts_when_it_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    stopped = {"run_seconds": 100.0, "peak_mib": 1e6, "most_disk_mib": 5.0}
    (tmp_path / "40-mesh.json").write_text(json.dumps(stopped))
    monkeypatch.setattr(scale, "command", lambda *_: [sys.executable, "-c", "pass"])
    found = scale.run(40, tmp_path, "mesh")
    assert 100.0 < found["run_seconds"] < 160.0
    assert (found["peak_mib"], found["most_disk_mib"]) == (1e6, 5.0)
    Records(tmp_path / "40-mesh" / "runs" / "records").write(record() | {"status": "timeout", "reason": "stopped"})
    with pytest.raises(SystemExit, match="of 40 shapes: stopped"):
        scale.run(40, tmp_path, "mesh")


def test_the_page_marks_what_was_not_measured() -> None:
    page = _scale_page.page({"1000": {"disk_mib": 11.0}, "2000": {"disk_mib": 24.0}})
    (line,) = [line for line in page.splitlines() if line.startswith("| disk at the end")]
    assert [cell.strip() for cell in line.split("|")[2:-1]] == ["≈ 1.01", "11", "24", "≈ 56", "≈ 200"]


def test_neighbours_are_measured_and_of_some_shapes_alone_where_there_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    found = scale.neighbours(60)
    assert found.keys() == _scale_page.NEIGHBOURS.keys()
    assert found["recall_1"] == found["recall_k"] == 1.0
    monkeypatch.setattr(scale, "MOST_SHAPES", 50)
    monkeypatch.setattr(scale, "SOME_SHAPES", 30)
    assert scale.neighbours(60)["recall_k"] == 1.0


def test_the_page_tells_of_sizes_beyond() -> None:
    one = {
        "run_seconds": 9.0,
        "stages": {"mesh classic-mds": {"prepare": 0.36}},
        "nearest_seconds": 10.0,
        "recall_1": 0.9,
    }
    page = _scale_page.page({"4000": one, "10000": {"nearest_seconds": 40.0, "recall_1": 0.8, "record_mib": 0.5}})
    cells = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in page.splitlines() if line.startswith("|")}
    assert [cell.strip() for cell in cells["share of the nearest shapes that was found"]] == ["0.9", "0.8", "--", "--"]
    assert [cell.strip() for cell in cells["matrix of all pairs, GiB"]] == ["0.119", "0.745", "74.5", "7450"]
    hours = cells["prepare of mesh classic-mds, hours on one core"]
    assert [cell.strip() for cell in hours] == ["≈ 0.4", "≈ 1", "≈ 10", "≈ 100"]
    assert cells[_scale_page.NEIGHBOURS["nearest_seconds"]][0].strip() == "10"
