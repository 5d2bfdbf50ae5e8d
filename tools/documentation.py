"""Hooks of ``make docs``: pages outside ``docs/``, links and docstrings.

mkdocs calls the functions that begin with ``on_``; griffe, which reads the docstrings, creates a
:class:`Docstrings`. Pages use relative links as in the repository: a link to a file on the site
leads there; any other link, for example to code, becomes plain text."""

from __future__ import annotations

import json
import posixpath
import re
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from griffe import Extension
from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

from benchmark.pipeline.records import read_records
from benchmark.report.data_titles import official_set
from benchmark.report.forms import StoredForms
from benchmark.report.page_builder import data_label, heading_of_table
from benchmark.report.pages import fixed_file, report_files, table_html
from benchmark.report.play import play_galleries, play_page, render_play_page
from benchmark.report.tables import table_views

if TYPE_CHECKING:
    from griffe import Object
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).resolve().parents[1]

#: Style of the tables of a report, and what sorts them.
OF_REPORT = ("table.css", "report.js")

#: Published tables by their path; they are shown as in a report.
PUBLISHED_TABLES = {
    f"results/tables/{view.stem}.md": view
    for view in table_views(read_records(REPOSITORY / "results", local=False), paper=True)
}

#: The report of these tables, and what links to it: in the repository, the folder of the tables.
REPORT, REPORTED = "report/index.html", "results/tables"

#: The page to play with, and the small data that it shows where no quick run is kept.
PLAY, PLAY_DATA = "play.html", REPOSITORY / "results" / "figures" / "play.json"

#: Examples that are pages of the site, by their path.
EXAMPLES = {
    path.relative_to(REPOSITORY).as_posix(): f"examples/{path.name.replace('.', '-')}.md"
    for pattern in ("*.py", "*.cpp", "*.m")
    for path in sorted((REPOSITORY / "examples").glob(pattern))
    if not path.name.startswith("test_")
}

#: Languages of examples by the end of their name.
LANGUAGES = {".py": "python", ".cpp": "cpp", ".m": "matlab"}

#: Where pages of the report name each other, and here also the documentation.
NAVIGATION = '<nav aria-label="Tables">'

#: Files outside ``docs/`` that are pages or pictures of the site.
EXTRA_PAGES = (
    "*.md",
    "learned/models/README.md",
    "results/tables/*.md",
    "results/experiments/*.*",
    "results/*/*.png",
)

#: Modules whose docstrings form the reference: the interface for authors, results, methods and
#: scorers.
DOCUMENTED = (
    "benchmark/api/*.py",
    "benchmark/commands/canonicalise.py",
    "benchmark/commands/compare.py",
    "benchmark/commands/forget.py",
    "benchmark/commands/form.py",
    "benchmark/commands/listing.py",
    "benchmark/commands/merge.py",
    "benchmark/commands/plan.py",
    "benchmark/commands/report.py",
    "benchmark/commands/retrieve.py",
    "benchmark/commands/run.py",
    "benchmark/commands/score.py",
    "benchmark/commands/tables.py",
    "benchmark/commands/train.py",
    "benchmark/report/results.py",
    "baselines/*.py",
    "retrieval/*.py",
)

#: Pages with other addresses: the front page of the repository is that of the site, before the list
#: of pages.
URIS = {"README.md": "index.md", "docs/README.md": "contents.md", **EXAMPLES}

LINK = re.compile(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)#\s]+)(#[^)\s]*)?\)")
PICTURE = re.compile(r'((?:src|srcset)=")([^"]+)')
INLINE_MATH = re.compile(r"\$`([^`]+)`\$")
MATH = re.compile(r"^```math\n(.*?)^```", re.MULTILINE | re.DOTALL)
ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`~?([\w.]+)`")
FORMULA = re.compile(r":math:`([^`]+)`")
DISPLAYED = re.compile(r"^\.\. math::[ ]*(.*(?:\n[ ]+\S.*)*)", re.MULTILINE)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the published tables and the reference of the code to the menu."""
    tables = [
        {f"{view.table.identifier}: {data_label(view)}": _uri(path)}
        for path, view in PUBLISHED_TABLES.items()
    ]
    tables += [
        {_title(path): _uri(path)}
        for path in _paths("results/tables/*.md")
        if path not in PUBLISHED_TABLES
    ]
    packages: dict[str, list[dict[str, str]]] = {}
    for module in _modules():
        packages.setdefault(module.rpartition(".")[0] or module, []).append(
            {module: f"api/{module}.md"}
        )
    config.nav = [
        *(config.nav or []),
        {"Published tables": tables},
        {"Examples": [{Path(path).name: uri} for path, uri in EXAMPLES.items()]},
        {"Code": [{k: v} for k, v in packages.items()]},
    ]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files outside ``docs/``, and a page for each documented module."""
    files.remove(files.src_uris["README.md"])
    for path in [*_paths(*EXTRA_PAGES), "docs/README.md"]:
        files.append(File.generated(config, _uri(path), abs_src_path=str(REPOSITORY / path)))
    files.append(File.generated(config, PLAY, content=play_page_of_site()))
    for path, uri in EXAMPLES.items():
        files.append(File.generated(config, uri, content=_example_page(path)))
    for name in OF_REPORT:
        files.append(File.generated(config, f"images/{name}", content=fixed_file(name)))
    for name, content in report_files(
        REPOSITORY / "results", list(PUBLISHED_TABLES.values())
    ).items():
        if isinstance(content, str):
            content = content.replace(
                NAVIGATION, f'{NAVIGATION}<a href="../index.html">Documentation</a>'
            )
        files.append(File.generated(config, f"{posixpath.dirname(REPORT)}/{name}", content=content))
    for module in _modules():
        files.append(
            File.generated(config, f"api/{module}.md", content=f"# {module}\n\n::: {module}\n")
        )
    return files


def play_page_of_site() -> str:
    """Return the page to play with, of the quick runs of generated sets that are kept here, or of small data.

    The geometry of official sets is not published.
    """
    results = REPOSITORY / "results"
    records = [
        record
        for record in read_records(results, published=False)
        if record.data.quick and not record.data.path and not official_set(record)
    ]
    if galleries := play_galleries(StoredForms(results), records):
        return play_page(galleries, back="index.html")
    data = json.loads(PLAY_DATA.read_bytes())
    return render_play_page(data["content"], data["numbers"], back="index.html")


def _example_page(path: str) -> str:
    """Return the page of an example: its name and its code."""
    code = (REPOSITORY / path).read_text(encoding="utf-8")
    language = LANGUAGES[Path(path).suffix]
    return f"# {Path(path).name}\n\n```{language}\n{code}```\n"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Convert the links of a page to addresses on the site."""
    address = page.file.src_uri
    if address.startswith("api/"):
        return markdown
    if view := PUBLISHED_TABLES.get(address.removeprefix("repository/")):
        page.meta["hide"] = ["toc"]  # a wide table has the room
        report = posixpath.relpath(REPORT, posixpath.dirname(address))
        lead = f"[Classes, maps and queries]({report})"
        return f"# {heading_of_table(view)}\n\n{lead}\n\n{table_html(view)}"
    source = next((path for path, uri in URIS.items() if uri == address), None)
    source = source or (
        address.removeprefix("repository/")
        if address.startswith("repository/")
        else f"docs/{address}"
    )

    def led(link: re.Match[str]) -> str:
        picture, text, target, anchor = link.groups(default="")
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        uri = REPORT if path == REPORTED else _uri(path)
        if uri not in files.src_uris:
            return text
        return f"{picture}[{text}]({posixpath.relpath(uri, posixpath.dirname(address) or '.')}{anchor})"

    def shown(found: re.Match[str]) -> str:
        start, target = found.groups()
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        return start + posixpath.relpath(_uri(path), posixpath.dirname(address) or ".")

    # Markdown leaves a <div> alone, and a <span> within its line.
    markdown = MATH.sub(lambda found: f"<div>{_formula(found[1], 'block')}</div>\n", markdown)
    markdown = INLINE_MATH.sub(
        lambda found: f"<span>{_formula(found[1], 'inline')}</span>", markdown
    )
    return PICTURE.sub(shown, LINK.sub(led, markdown))


class Docstrings(Extension):
    """Extension that converts roles and formulas of docstrings into links and MathML."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring:
            text = DISPLAYED.sub(lambda match: _formula(match[1], "block"), obj.docstring.value)
            text = FORMULA.sub(lambda match: _formula(match[1], "inline"), text)
            obj.docstring.value = ROLE.sub(_reference, text)


def _formula(latex: str, display: str) -> str:
    return convert(" ".join(latex.split()), display=display)


def _reference(role: re.Match[str]) -> str:
    name = escape(role[1])
    return f'<autoref identifier="{name}" optional><code>{name.rpartition(".")[2]}</code></autoref>'


def _paths(*patterns: str) -> list[str]:
    paths = [
        path.relative_to(REPOSITORY).as_posix()
        for pattern in patterns
        for path in sorted(REPOSITORY.glob(pattern))
    ]
    return list(dict.fromkeys(paths))


def _modules() -> list[str]:
    names = (path.removesuffix(".py").replace("/", ".") for path in _paths(*DOCUMENTED))
    return [name.removesuffix(".__init__") for name in names]


def _uri(path: str) -> str:
    """Return the address on the site of a file of the repository."""
    inside = path.removeprefix("docs/") if path.startswith("docs/") else f"repository/{path}"
    return URIS.get(path, inside)


def _title(path: str) -> str:
    words = Path(path).stem.replace("-", " ")
    return words[0].upper() + words[1:]
