"""Whatever a method raises becomes the record of its job, and ends nothing else."""

from types import SimpleNamespace

import pytest

from benchmark.execution.runner import _guarded
from tests.test_errors import Mute, MuteRefusal, Quits


def recorded(error):
    """The record of a job whose method raises."""
    written = []
    order = SimpleNamespace(key="a", facts={}, recipe={})
    with _guarded(order, SimpleNamespace(write_record=written.append), "cat0"):
        raise error
    (record,) = written
    return record


@pytest.mark.parametrize(
    ("error", "status", "reason"),
    [
        (SystemExit(0), "failed", "cat0: SystemExit: 0"),
        (GeneratorExit(), "failed", "cat0: GeneratorExit"),
        (BaseExceptionGroup("g", [SystemExit(0)]), "failed", "cat0: BaseExceptionGroup: g (1 sub-exception)"),
        (MemoryError(), "memory", "cat0: out of memory"),
        (Mute(), "failed", "cat0: Mute: its message cannot be read"),
        (Quits(), "failed", "cat0: Quits: its message cannot be read"),
        (MuteRefusal("thin", "feed it"), "failed", "cat0: its message cannot be read"),
    ],
)
def test_whatever_a_method_raises_is_the_record_of_its_job_and_names_the_shape(error, status, reason):
    record = recorded(error)
    assert record["status"] == status
    assert record["reason"].startswith(reason)


def test_an_interrupt_of_a_method_is_told_from_one_of_the_user(monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        recorded(KeyboardInterrupt())
    monkeypatch.setattr("benchmark.execution.runner.is_child", lambda: True)  # a worker, which hears of no Ctrl-C
    assert recorded(KeyboardInterrupt())["reason"] == "cat0: KeyboardInterrupt"
