"""Hooks of ``make docs``: pages outside ``docs/``, links and docstrings.

mkdocs calls the functions that begin with ``on_``; griffe, which reads the docstrings, creates a
:class:`Docstrings`. Pages use relative links as in the repository. The files to which they
lead are on the site, too."""

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

from benchmark.pipeline.record_files import read_records
from benchmark.report.data_titles import official_set
from benchmark.report.forms import StoredForms
from benchmark.report.page_builder import data_label, heading_of_table
from benchmark.report.pages import fixed_file, report_files, table_html
from benchmark.report.play import play_galleries, play_page, render_play_page
from benchmark.report.table_view import TableView
from benchmark.report.tables import table_views

if TYPE_CHECKING:
    from griffe import Object
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).resolve().parents[1]

#: Style of the tables of a report, what sorts them, and the icon of its pages.
OF_REPORT = ("table.css", "report.js", "icon.svg")

#: Published tables by their path; they are shown as in a report.
PUBLISHED_TABLES = {
    f"results/tables/{view.stem}.md": view
    for view in table_views(read_records(REPOSITORY / "results", local=False), paper=True)
}

#: The report of these tables.
REPORT = "report/index.html"

#: The list of examples.
LIST_OF_EXAMPLES = "examples/index.md"

#: Pages of the site that stand for folders of the repository.
PAGES_OF_FOLDERS = {
    "results/tables": REPORT,
    "examples": LIST_OF_EXAMPLES,
    "learned/models": "repository/learned/models/README.md",
}

#: The page to play with.
PLAY = "play.html"

#: The small data that it shows where no quick run is kept.
PLAY_DATA = REPOSITORY / "results" / "figures" / "play.json"

#: Languages of examples by the end of their name.
LANGUAGES = {".py": "python", ".cpp": "cpp", ".m": "matlab"}


def _examples() -> dict[str, str]:
    """Return the addresses of examples on the site, by their path."""
    addresses = {}
    for ending in LANGUAGES:
        for path in sorted((REPOSITORY / "examples").glob(f"*{ending}")):
            if not path.name.startswith("test_"):
                address = f"examples/{path.name.replace('.', '-')}.md"
                addresses[path.relative_to(REPOSITORY).as_posix()] = address
    return addresses


#: Examples that are pages of the site.
EXAMPLES = _examples()

#: Where pages of the report name each other, and here also the documentation.
NAVIGATION = '<nav aria-label="Tables">'

#: Files outside ``docs/`` that are pages or pictures of the site.
EXTRA_PAGES = (
    "*.md",
    "learned/models/README.md",
    "results/README.md",
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
SHORT_CODE = re.compile(r"<code>([^<\n]{1,24})</code>")
THOUSANDS = re.compile(r"(?<=\d) (?=\d{3}\b)")
INLINE_MATH = re.compile(r"\$`([^`]+)`\$")
MATH = re.compile(r"^```math\n(.*?)^```", re.MULTILINE | re.DOTALL)
ROLE = re.compile(r":(?:attr|class|data|func|meth|mod):`~?([\w.]+)`")
FORMULA = re.compile(r":math:`([^`]+)`")
DISPLAYED = re.compile(r"^\.\. math::[ ]*(.*(?:\n[ ]+\S.*)*)", re.MULTILINE)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the published tables and the reference of the code to the menu."""
    tables = [
        {_unbroken(f"{view.table.identifier}: {data_label(view)}"): _uri(path)}
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
        {
            "Examples": [
                LIST_OF_EXAMPLES,
                *({Path(path).name: uri} for path, uri in EXAMPLES.items()),
            ]
        },
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
    files.append(File.generated(config, LIST_OF_EXAMPLES, content=_list_of_examples()))
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
    for path in _linked_files(files):
        if _uri(path) not in files.src_uris:
            files.append(File.generated(config, _uri(path), abs_src_path=str(REPOSITORY / path)))
    return files


def _linked_files(files: Files) -> set[str]:
    """Return the files of the repository to which pages of the site link."""
    linked = set()
    for file in files.documentation_pages():
        source = _source(file.src_uri)
        page = REPOSITORY / source
        if page.suffix == ".md" and page.is_file():
            for link in LINK.finditer(page.read_text(encoding="utf-8")):
                path = _path_of_link(source, link[3])
                if not path.startswith("..") and (REPOSITORY / path).is_file():
                    linked.add(path)
    return linked


def _path_of_link(source: str, target: str) -> str:
    """Return the path in the repository to which a link of a file leads."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(source), target))


def play_page_of_site() -> str:
    """Return the page to play with, of the quick runs that are kept here, or of small data.

    The geometry of official sets is not published.
    """
    results = REPOSITORY / "results"
    records = [
        record
        for record in read_records(results, published=False)
        if record.data.quick and not record.data.path and not official_set(record)
    ]
    galleries = play_galleries(StoredForms(results), records)
    if galleries:
        return play_page(galleries, back="index.html")
    data = json.loads(PLAY_DATA.read_bytes())
    return render_play_page(data["content"], data["numbers"], back="index.html")


def _example_page(path: str) -> str:
    """Return the page of an example: its name and its code."""
    code = (REPOSITORY / path).read_text(encoding="utf-8")
    language = LANGUAGES[Path(path).suffix]
    return f"# {Path(path).name}\n\n```{language}\n{code}```\n"


def _list_of_examples() -> str:
    """Return the page that lists the examples, each with the first line of its description."""
    lines = ["# Examples", ""]
    for path, uri in EXAMPLES.items():
        first, *_ = (REPOSITORY / path).read_text(encoding="utf-8").splitlines()
        description = first.strip('"/% ').replace("``", "`")
        lines.append(f"- [{Path(path).name}]({posixpath.basename(uri)}): {description}")
    return "\n".join(lines) + "\n"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Convert the links of a page to addresses on the site."""
    address = page.file.src_uri
    if address.startswith("api/"):
        return markdown
    view = PUBLISHED_TABLES.get(address.removeprefix("repository/"))
    if view is not None:
        page.meta["hide"] = ["toc"]  # a wide table has the room
        return _page_of_table(view, address)
    source = _source(address)

    def converted(link: re.Match[str]) -> str:
        """Return a link with its address on the site; of a wrong one, mkdocs says so."""
        picture, text, target, anchor = link.groups(default="")
        path = _path_of_link(source, target)
        uri = PAGES_OF_FOLDERS.get(path) or _uri(path)
        return f"{picture}[{text}]({_relative(uri, address)}{anchor})"

    def converted_picture(picture: re.Match[str]) -> str:
        """Return the beginning of a picture in HTML with its address on the site."""
        start, target = picture.groups()
        path = _path_of_link(source, target)
        return start + _relative(_uri(path), address)

    # Markdown leaves a <div> alone, and a <span> within its line.
    markdown = MATH.sub(
        lambda found: f"<div class='formula'>{_formula(found[1], 'block')}</div>\n", markdown
    )
    markdown = INLINE_MATH.sub(
        lambda found: f"<span>{_formula(found[1], 'inline')}</span>", markdown
    )
    return PICTURE.sub(converted_picture, LINK.sub(converted, markdown))


def on_page_content(html: str, **_: Any) -> str:
    """Keep words of code in one line, such as options, which browsers break at hyphens."""
    return SHORT_CODE.sub(r'<code class="short">\1</code>', html)


def _page_of_table(view: TableView, address: str) -> str:
    """Return the page of a published table."""
    lead = f"[Classes, maps and queries]({_relative(REPORT, address)})"
    return f"# {_unbroken(heading_of_table(view))}\n\n{lead}\n\n{table_html(view)}"


def _unbroken(title: str) -> str:
    """Return a title in which no number of thousands is broken at its blank."""
    return THOUSANDS.sub("\N{NO-BREAK SPACE}", title)


def _relative(uri: str, address: str) -> str:
    """Return the way from a page of the site to a file of it."""
    return posixpath.relpath(uri, posixpath.dirname(address) or ".")


def _source(address: str) -> str:
    """Return the file of the repository that a page of the site shows."""
    for path, uri in URIS.items():
        if uri == address:
            return path
    if address.startswith("repository/"):
        return address.removeprefix("repository/")
    return f"docs/{address}"


class Docstrings(Extension):
    """Extension that converts roles and formulas of docstrings into links and MathML."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrite the docstring of an object."""
        if obj.docstring:
            text = DISPLAYED.sub(lambda match: _formula(match[1], "block"), obj.docstring.value)
            text = FORMULA.sub(lambda match: _formula(match[1], "inline"), text)
            obj.docstring.value = ROLE.sub(_reference, text)


def _formula(latex: str, display: str) -> str:
    """Return a formula as MathML."""
    return convert(" ".join(latex.split()), display=display)


def _reference(role: re.Match[str]) -> str:
    """Return a role as a link to what it names, if the site has it."""
    name = escape(role[1])
    _, _, short = name.rpartition(".")
    return f'<autoref identifier="{name}" optional><code>{short}</code></autoref>'


def _paths(*patterns: str) -> list[str]:
    """Return the files of the repository that match patterns, each once."""
    paths: dict[str, None] = {}
    for pattern in patterns:
        for path in sorted(REPOSITORY.glob(pattern)):
            paths[path.relative_to(REPOSITORY).as_posix()] = None
    return [*paths]


def _modules() -> list[str]:
    """Return the names of the modules that form the reference."""
    names = [path.removesuffix(".py").replace("/", ".") for path in _paths(*DOCUMENTED)]
    return [name.removesuffix(".__init__") for name in names]


def _uri(path: str) -> str:
    """Return the address on the site of a file of the repository."""
    if path in URIS:
        return URIS[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return f"repository/{path}"


def _title(path: str) -> str:
    """Return the title of a page without a heading: the name of its file."""
    words = Path(path).stem.replace("-", " ")
    return words[0].upper() + words[1:]
