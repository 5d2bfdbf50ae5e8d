import sys
import threading
from types import SimpleNamespace

import pytest

from benchmark import machine
from benchmark.errors import ConfigurationError


@pytest.mark.parametrize(
    ("groups", "files", "memory"),
    [
        ("0::/\n", {}, float("inf")),
        ("0::/a\n", {"a/memory.max": "2147483648\n", "memory.max": "max\n"}, 2**31),
        ("0::/job/a\n", {"job/memory.max": "1024\n", "job/a/memory.max": "max\n"}, 1024),
        ("4:memory:/a\n", {}, float("inf")),
    ],
    ids=["no limit", "limit", "limit of a group above", "version 1"],
)
def test_a_container_limits_memory(tmp_path, monkeypatch, groups, files, memory):
    (tmp_path / "groups").write_text(groups)
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(machine, "_CONTROL_GROUPS", tmp_path)
    monkeypatch.setattr(machine, "_GROUPS_OF_PROCESS", tmp_path / "groups")
    assert machine.memory_limit() == memory


@pytest.mark.parametrize("threads", [None, "1", "3"])
def test_items_that_threads_share_keep_their_order(monkeypatch, threads):
    monkeypatch.setenv(machine.THREADS, threads or "")
    if threads is None:
        monkeypatch.delenv(machine.THREADS)
    used = set()

    def double(item):
        used.add(threading.get_ident())
        return 2 * item

    assert machine.in_threads(double, range(50)) == [*range(0, 100, 2)]
    is_shared = threads == "3"
    assert (threading.get_ident() not in used) == is_shared


@pytest.mark.parametrize("threads", ["", "0", "-2", "1.5", "all"])
def test_what_is_no_number_of_threads_is_refused(monkeypatch, threads):
    monkeypatch.setenv(machine.THREADS, threads)
    with pytest.raises(ConfigurationError, match="not a number of threads; unset it"):
        machine.in_threads(str, "abc")


def test_a_gpu_is_named_from_when_this_process_uses_it(monkeypatch):
    used = []
    cuda = SimpleNamespace(
        is_available=lambda: True,
        is_initialized=lambda: bool(used),
        get_device_name=lambda: "a large GPU",
    )
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=cuda))
    before = machine.describe_machine()
    assert "GPU" not in before
    used.append(True)
    assert machine.describe_machine() == f"{before}, a large GPU"
