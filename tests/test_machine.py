import os

import pytest

from benchmark import machine
from benchmark.machine import available_cores


def test_cores_are_those_that_the_process_may_use_or_those_of_the_machine(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 5, 7}, raising=False)
    assert available_cores() == 3
    # macOS has no such function; a system that does not know its cores has one.
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert available_cores() == 6
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert available_cores() == 1


@pytest.mark.parametrize(
    ("groups", "files", "cores", "memory"),
    [
        ("0::/\n", {}, 3, float("inf")),
        ("0::/job/a\n", {"job/cpu.max": "250000 100000\n", "job/a/cpu.max": "max 100000\n"}, 2, float("inf")),
        ("0::/a\n", {"a/memory.max": "2147483648\n", "memory.max": "max\n"}, 3, 2**31),
        (
            "4:memory:/a\n2:cpu,cpuacct:/a\n",
            {"memory/a/memory.limit_in_bytes": "1024\n", "cpu/cpu.cfs_quota_us": "50000\n",
             "cpu/cpu.cfs_period_us": "100000\n"},
            1, 1024,
        ),
        ("2:cpu:/a\n", {"cpu/a/cpu.cfs_quota_us": "-1\n", "cpu/a/cpu.cfs_period_us": "100000\n"}, 3, float("inf")),
    ],
    ids=["no limit", "quota of a group above", "memory", "version 1", "version 1 without a limit"],
)  # fmt: skip
def test_a_container_limits_cores_and_memory(tmp_path, monkeypatch, groups, files, cores, memory):
    (tmp_path / "groups").write_text(groups)
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(machine, "_MOUNTED", tmp_path)
    monkeypatch.setattr(machine, "_GROUPS", tmp_path / "groups")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 5, 7}, raising=False)
    assert available_cores() == cores
    assert machine.memory_limit() == memory
