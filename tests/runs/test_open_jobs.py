"""Jobs wait for missing files; then they are ready, or incomplete for a reason."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from benchmark.pipeline.cache import CachedFile
from benchmark.runs.open_jobs import OpenJobs

PREPARED = CachedFile("prepared", "p")
FORM = CachedFile("forms", "f")
SIGNATURE = CachedFile("signatures", "s")
OTHER = CachedFile("forms", "g")


def job(key: str) -> Any:
    return SimpleNamespace(record=SimpleNamespace(key=key))


def step(file: CachedFile, key: str = "") -> Any:
    return SimpleNamespace(stage=file.stage, file=file, job=SimpleNamespace(key=key))


@pytest.fixture
def both() -> tuple[OpenJobs, Any, Any]:
    """Two jobs: one needs a signature of a form of a shape, the other only another form of it."""
    first = job("first")
    second = job("second")
    jobs = OpenJobs({"first": first, "second": second})
    for source, file in ((PREPARED, FORM), (FORM, SIGNATURE), (PREPARED, OTHER)):
        jobs.add_made_from(source, file)
    for file in (PREPARED, FORM, SIGNATURE):
        jobs.add_missing(first, file)
    for file in (PREPARED, OTHER):
        jobs.add_missing(second, file)
    return jobs, first, second


def test_a_job_waits_until_all_its_files_are_made(both):
    jobs, first, second = both
    assert jobs.n_missing == 5
    assert jobs.mark_made(PREPARED) == [first, second]
    assert jobs.mark_made(FORM) == [first]
    assert jobs.state(first) == "waiting"
    assert jobs.mark_made(SIGNATURE) == [first]
    assert (jobs.state(first), jobs.state(second)) == ("ready", "waiting")
    assert jobs.n_missing == 1


def test_what_is_made_from_a_lost_file_is_lost_too(both):
    jobs, first, second = both
    jobs.mark_made(PREPARED)
    assert jobs.mark_lost(FORM) == [first]
    assert (jobs.state(first), jobs.state(second)) == ("ready", "waiting")
    assert not jobs.is_wanted(step(SIGNATURE))


def test_a_reason_leaves_all_jobs_of_a_shape_incomplete(both):
    jobs, first, second = both
    assert jobs.mark_lost(PREPARED, "its file changed") == [first, second]
    assert (jobs.state(first), jobs.state(second)) == ("incomplete", "incomplete")
    assert jobs.reason(first) == "its file changed"


def test_the_same_reason_is_named_once_and_others_are_counted(both):
    jobs, first, _ = both
    for reason in ("a", "a", "b"):
        jobs.add_reason(first, reason)
    assert jobs.reason(first) == "a (and 1 more)"


def test_nothing_is_wanted_for_a_closed_job(both):
    jobs, first, second = both
    jobs.close(first)
    assert jobs.waiting_for(step(PREPARED)) == [second]
    assert not jobs.is_wanted(step(SIGNATURE))
    assert not jobs.is_wanted(step(CachedFile("records", "first"), "first"))
    assert [*jobs] == [second]


def test_a_file_that_a_job_lacks_twice_counts_once(both):
    jobs, first, _ = both
    jobs.add_missing(first, FORM)
    assert jobs.n_missing == 5
    assert jobs.mark_made(FORM) == [first]
