"""What all pages of a report share: templates, navigation, pictures, and what tables are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from jinja2 import Environment, PackageLoader

from benchmark.report.data_titles import short_data_title
from benchmark.report.drawing import OBLIQUE, PALETTE, shaded, webp
from benchmark.report.figures import MEASURE
from benchmark.report.forms import Drawn, StoredForms
from benchmark.report.notation import file_name, hundredths
from benchmark.report.record_facts import change_of
from benchmark.report.statistics import INTERVALS
from benchmark.report.table_view import TableView
from benchmark.text import clean_text

#: Pages of a table by the end of their name.
PAGES_OF_TABLE = {"": "Scores", "-forms": "Forms", "-queries": "Queries"}

#: The page to play with.
PLAY_PAGE = "play.html"

#: Pixels of the picture of a form on a page of forms.
FORM_PIXELS = 240


#: The blank between the thousands of a number, at which no line may break.
_THOUSANDS = re.compile(r"(?<=\d) (?=\d{3}\b)")
_NO_BREAK = "\xa0"


def _shown(value: Any) -> Any:
    """Return a value as a template shows it.

    None is nothing. Texts have no control characters, and no line breaks within their numbers.
    """
    if value is None:
        return ""
    if type(value) is str:  # and no markup, which is a kind of str
        return _THOUSANDS.sub(_NO_BREAK, clean_text(value))
    return value


TEMPLATES = Environment(
    loader=PackageLoader("benchmark.report"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=_shown,
)
TEMPLATES.globals |= {
    "measure": MEASURE,
    "side": FORM_PIXELS,
    "kind_names": PAGES_OF_TABLE,
    "intervals": INTERVALS,
    "palette": PALETTE,
    "viewing": OBLIQUE.direction,
}
TEMPLATES.filters |= {"anchor": file_name, "hundredths": hundredths}


@dataclass
class Pages:
    """Pages and pictures under construction.

    Parameters
    ----------
    forms
        Reader of the forms of a results folder.
    views
        The tables.
    files
        Contents by name.
    """

    forms: StoredForms
    views: Sequence[TableView]
    files: dict[str, str | bytes] = field(default_factory=dict)

    def add(self, name: str, template: str, title: str, window: str = "", **content: Any) -> None:
        """Add a page.

        Parameters
        ----------
        name
            Name of its file.
        template
            Name of its template.
        title
            Its heading.
        window
            Title of its window, of which a tab shows the beginning; by default the heading.
        content
            What the template reads.
        """
        self.files[name] = TEMPLATES.get_template(template).render(
            title=title,
            window=window or title,
            here=name,
            groups=self._navigation(),
            has_overview=len(self.views) > 1,
            play=PLAY_PAGE if PLAY_PAGE in self.files else "",
            **content,
        )

    def _navigation(self) -> dict[str, dict[str, str]]:
        """Return the tables that have pages: their labels by data and address."""
        groups: dict[str, dict[str, str]] = {}
        for view in self.views:
            if self.main(view) is view:
                label = view.table.identifier
                if view.is_of_own_data:
                    label = view.own_gallery or "own"
                groups.setdefault(data_label(view), {})[view.stem] = label
        return groups

    def main(self, view: TableView) -> TableView:
        """Return the table on whose pages another one stands: that of the unchanged views."""
        change = change_of(view.dataset)
        if change is None or not view.table.is_cross:
            return view
        for other in self.views:
            if other.table == view.table and other.dataset == change.base:
                return other
        return view

    def picture(
        self, name: str, drawn: Drawn | None, size: int, *, is_coloured: bool = False
    ) -> str:
        """Return the name of the picture of a surface, which is drawn once.

        It is "" without a surface.
        """
        if drawn is None:
            return ""
        file = f"pictures/{file_name(name)}.webp"
        if file not in self.files:
            values = drawn.values if is_coloured else None
            self.files[file] = webp(shaded(drawn.mesh, OBLIQUE, size, values))
        return file


def heading_of_table(view: TableView) -> str:
    """Return the heading of the pages of a table."""
    if view.is_of_own_data:
        return view.caption
    return f"Table {view.table.identifier}. {view.caption}"


def label_of_table(view: TableView) -> str:
    """Return a short name of a table and its data."""
    if view.is_of_own_data:
        return f"{data_label(view)} {view.own_gallery}".strip()
    return f"{view.table.identifier}: {data_label(view)}"


def data_label(view: TableView) -> str:
    """Return a short name of the data of a table."""
    name = view.sample.data.name
    if "/" in name:  # by its path, a folder is told apart from another one of its name
        return clean_text(name)
    return clean_text(short_data_title(view.sample))
