"""Workflows of continuous integration call known targets, may only read, and hold no secret."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))


@pytest.fixture(params=WORKFLOWS, ids=lambda path: path.stem)
def workflow(request):
    return yaml.safe_load(request.param.read_text(encoding="utf-8"))


def called_targets(workflow):
    """Return the targets of the Makefile that the steps of a workflow call."""
    targets = set()
    for job in workflow["jobs"].values():
        for step in job["steps"]:
            for line in step.get("run", "").splitlines():
                if line.startswith("make "):
                    targets.update(line.split()[1:])
    return targets


def test_a_workflow_calls_targets_that_exist(workflow):
    assert called_targets(workflow) <= TARGETS


def test_every_job_ends(workflow):
    assert all("timeout-minutes" in job for job in workflow["jobs"].values())


def test_a_workflow_may_only_read_unless_it_publishes(workflow):
    assert workflow["permissions"]["contents"] == "read"
    written = {name for name, right in workflow["permissions"].items() if right == "write"}
    assert written <= {"pages", "id-token"}


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_no_workflow_names_a_secret(path):
    assert "secrets." not in path.read_text(encoding="utf-8")


def test_all_groups_of_tests_run():
    text = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    groups = {"test", "test-slow", "golden", "processors", "check-tables", "bench", "coverage"}
    assert groups <= called_targets(yaml.safe_load(text))


def test_nothing_is_published_with_made_up_addresses():
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    assert ".example pyproject.toml" in text
