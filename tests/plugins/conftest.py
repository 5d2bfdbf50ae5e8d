"""Checks of plugins, in this process."""

import json
from pathlib import Path

import pytest

from benchmark.plugins import conformance
from benchmark.plugins.conformance import checks

EXAMPLES = Path(__file__).parents[2] / "examples"


def call_here(function, *arguments, **_):
    """Stands for a call in a process of its own: starting one takes a second. What is answered travels as JSON."""
    return json.loads(json.dumps(function(*arguments)))


@pytest.fixture
def in_this_process(monkeypatch):
    monkeypatch.setattr(checks, "call_apart", call_here)
    monkeypatch.setattr(checks, "hide_data", lambda: None)  # it would be hidden from all further tests


@pytest.fixture
def findings_in(tmp_path, in_this_process):
    """What is found in an example, after an edit."""

    def check(example, old, new, before=""):
        source = (EXAMPLES / example).read_text()
        assert old in source
        path = tmp_path / f"edited_{abs(hash((old, new)))}.py"
        path.write_text(before + (source.replace("from __future__", "#") if before else source).replace(old, new))
        (found,) = conformance.check_target(str(path)).findings.values()
        return {finding.name: finding for finding in found}

    return check
