"""The pages of the documentation hang together, and name what is there."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest
import typer

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.registry import select, select_one
from benchmark.registry.known import BUILT_IN, SCORERS
from learned.fitting import Machine
from learned.training import Schedule
from retrieval.measures import MEASURES
from tests.golden.components import GENERATED
from tests.verbs import VERBS

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
#: All pages but the published tables, which are compared byte for byte.
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *DOCS,
    ROOT / "learned/models/README.md",
    ROOT / "results/README.md",
    ROOT / "results/experiments/README.md",
]
TEXTS = {page: page.read_text(encoding="utf-8") for page in PAGES}


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def prose(text: str) -> str:
    """A page without its blocks of code."""
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as they stand in links."""
    found = re.findall(r"^#+ (.*)$", prose(TEXTS[page]), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


def links(page: Path) -> Iterator[tuple[Path, str]]:
    """Targets in this repository that a page links to, each with its anchor."""
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(TEXTS[page])):
        if "://" not in target:
            path, _, anchor = target.partition("#")
            yield Path(os.path.normpath(page.parent / path)) if path else page, anchor


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_link_leads_somewhere_from_its_own_page(page: Path) -> None:
    assert [str(target) for target, _ in links(page) if not target.exists()] == []
    wrong = [
        (name(target), anchor)
        for target, anchor in links(page)
        if anchor and anchor not in anchors(target)
    ]
    assert wrong == []


def test_every_page_is_linked_from_the_first() -> None:
    first = ROOT / "docs" / "README.md"
    assert first in {target for target, _ in links(ROOT / "README.md")}
    assert [
        name(page) for page in DOCS if page not in {first, *(target for target, _ in links(first))}
    ] == []


def sources() -> Iterator[Path]:
    for folder in ("baselines", "benchmark", "examples", "learned", "retrieval", "tests"):
        yield from sorted((ROOT / folder).rglob("*.py"))
    yield from (ROOT / "Makefile", ROOT / ".ci" / "run")


def test_every_page_that_the_code_names_exists() -> None:
    named = {
        (page, path)
        for path in sources()
        for page in re.findall(r"docs/[\w/-]+\.md", path.read_text("utf-8"))
    }
    assert len(named) >= 5
    assert [(page, name(path)) for page, path in named if not (ROOT / page).is_file()] == []


def test_every_section_that_a_message_names_exists() -> None:
    pattern = r"'([A-Z][\w ]+)' in (?:the )?(docs/[\w/-]+\.md|README)"
    named = {found for path in sources() for found in re.findall(pattern, path.read_text("utf-8"))}
    assert named
    for section, page in named:
        target = ROOT / (page if page.endswith(".md") else f"{page}.md")
        assert f"# {section}\n" in TEXTS[target], (section, page)


def test_every_commit_and_its_file_that_a_page_names_is_in_the_history() -> None:
    text = " ".join(" ".join(TEXTS.values()).split())
    named = re.findall(r"\b[0-9a-f]{8}\b", text)
    named += [
        f"{commit}:{path}"
        for path, commit in re.findall(r"`([\w/]+\.py)` (?:at|of) commit (\w{8})", text)
    ]
    words = ["git", "cat-file", "--batch-check"]
    done = subprocess.run(
        words, cwd=ROOT, input="\n".join(named), capture_output=True, text=True, check=False
    )
    if done.returncode or (ROOT / ".git" / "shallow").exists():
        pytest.skip("needs the history")
    assert [
        line for line in done.stdout.splitlines() if not re.search(" (commit|blob) ", line)
    ] == []


def test_the_page_of_measures_names_each_one() -> None:
    page = TEXTS[ROOT / "docs" / "reference" / "scorers.md"].partition("## Measures")[2]
    named = {*re.findall(r"[\w@]+", page)}
    assert [measure for measure in MEASURES if measure not in named] == []


def test_the_page_of_data_sets_names_each_generated_one() -> None:
    generated = {name.partition("[")[0] for name, known in CATALOGUE.items() if not known.folder}
    page = TEXTS[ROOT / "docs" / "data.md"]
    assert [name for name in sorted(generated) if not re.search(rf"`{name}[`\[]", page)] == []
    assert [name for name in sorted(generated) if name not in GENERATED] == []


def test_the_page_on_training_names_each_option_and_no_other() -> None:
    page = TEXTS[ROOT / "docs" / "how-to" / "train.md"]
    table = page.partition("| Option | What it sets |")[2].partition("\n\n")[0]
    cells = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    named = re.findall(r"`(\w+)", " ".join(cells))
    options = [field.name for part in (Schedule, Machine) for field in fields(part)]
    assert sorted(named) == sorted(options)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_make_target_and_verb_exists(page: Path) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"(?:^ *|`)make ([\w-]+)", TEXTS[page], re.MULTILINE)
    assert [
        target for target in targets if not re.search(rf"^{target}:", makefile, re.MULTILINE)
    ] == []
    verbs = set(re.findall(r"python -m benchmark ([a-z]+)", TEXTS[page]))
    assert verbs <= VERBS.keys()


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_option_of_a_command_exists(page: Path) -> None:
    text = re.sub(r"\\\n *", "", TEXTS[page])
    for line in re.findall(r"^ *python -m benchmark (.*)$", text, re.MULTILINE):
        first, *words = shlex.split(line, comments=True)
        command = VERBS[first]
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0).partition("|")[0]]
        command.make_parser(typer.Context(command)).parse_args(words)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_parameter_of_a_method_or_scorer_exists(page: Path) -> None:
    for name, parameters in re.findall(r"\b([a-z][a-z-]+)(\[\w+=[^\]`$]+\])", TEXTS[page]):
        if name in SCORERS:
            select_one(name + parameters, kind="scorer")
        elif name in BUILT_IN:
            select([name + parameters])


def test_the_command_line_lists_every_verb() -> None:
    page = TEXTS[ROOT / "docs" / "reference" / "command-line.md"]
    names = re.findall(r"^- (`.*`):", page, re.MULTILINE)
    listed = set(re.findall(r"`(\w+)[^`]*`", "\n".join(names)))
    assert VERBS.keys() <= listed


# The page of the architecture
# ----------------------------------------------------------------------------------------

ARCHITECTURE = TEXTS[ROOT / "docs" / "architecture.md"]


def test_every_file_and_name_in_it_that_the_architecture_names_exists() -> None:
    named = re.findall(r"`((?:baselines|benchmark|learned|retrieval)/[\w/.]+)`", ARCHITECTURE)
    assert len(named) > 20
    assert [path for path in named if "NAME" not in path and not (ROOT / path).exists()] == []
    defined = re.findall(r"`(\w+)` in `([\w/]+\.py)`", ARCHITECTURE)
    flows = [len(re.findall(r"^\d+\. ", flow, re.MULTILINE)) for flow in ARCHITECTURE.split("###")]
    assert max(flows) <= 10 <= len(defined)
    for name, path in defined:
        assert re.search(
            rf"^(def |class )?{name}\b", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE
        ), name
