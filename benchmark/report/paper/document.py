"""The files of a paper: what its templates are filled with. The environment escapes all that comes from data."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import resources
from typing import Any, Literal, get_args

from benchmark import __version__
from benchmark.geometry.depth import SIZE
from benchmark.pipeline.stages.complete import N_VERTICES
from benchmark.pipeline.storage.keys import digest
from benchmark.protocols.tables import INPUTS
from benchmark.reference.paper import NUMERALS
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.cell import Cell
from benchmark.report.content import TableContent
from benchmark.report.escaping import latex_prose
from benchmark.report.formats import bibliography
from benchmark.report.latex import ENVIRONMENT, Latex, appendix, data_source, latex, scorer_cited
from benchmark.report.notes import notes
from benchmark.report.paper import facts
from benchmark.report.pictures.charts import MEASURE, scores_figure
from benchmark.report.pictures.forms import stored_forms_figure
from benchmark.report.pictures.painting import as_file
from benchmark.report.reproduction import AGREEING, OUTCOMES, TOLERANCE, assess_claims, paper_tables, reproduced_figures
from benchmark.report.significance import DRAWS, RESAMPLES

Template = Literal["article", "ieee"]
"""Classes of a paper."""

TEMPLATES: tuple[Template, ...] = get_args(Template)

#: Inches of the text by template.
_INCHES = {"article": 6.45, "ieee": 7.1}

#: Rows without results of all shapes that are named one by one.
_MOST_NAMED = 12

#: Beyond Latin letters, which are composed, what LaTeX has in its oldest encoding.
_KNOWN = frozenset("\u00a0¡£§©¬®°±²³µ¶·¹¼½¾¿ÆØæßøıŁłŒœ\u2010\u2011\u2012–—―‘’“”†‡•…‰€™")


#: Accents, and letters with a cedilla, that are composed.
_ABOVE = frozenset("\u0300\u0301\u0302\u0303\u0304\u0306\u0307\u0308\u030a\u030b\u030c")
_CEDILLAS = frozenset(f"{letter}\u0327" for letter in "CcSsTt")


def main_tables(tables: Sequence[TableContent]) -> list[TableContent]:
    """Return the tables of the paper, of the official set or else of the stand-in, and those of one's own data."""
    found: dict[str, TableContent] = {}
    for table in tables:
        known = found.get(table.identifier)
        if table.identifier in NUMERALS and not table.is_own and (known is None or known.data["stand_in_for"]):
            found[table.identifier] = table
    return [*found.values(), *(table for table in tables if table.is_own)] or list(tables)


def paper_files(tables: Sequence[TableContent], artefacts: ArtefactReader, template: Template) -> dict[str, bytes]:
    """Return all files of a paper by name.

    Parameters
    ----------
    tables
        The tables that it has.
    artefacts
        Where canonical forms are, as far as they are here; without them it has no figure of forms.
    template
        The class of the paper.
    """
    width = _INCHES[template]
    texts: dict[str, str] = {}
    figures: dict[str, bytes] = {}
    told = []
    for table in tables:
        name = f"figures/scores-{_stem(table)}.pdf"
        if (figure := scores_figure(table, width)) is not None:
            figures[name] = as_file(figure, ".pdf")
        texts[f"tables/{_stem(table)}.tex"] = latex(table, _stem(table), has_notes=False)
        told.append(_table(table, name.partition("/")[2] if name in figures else ""))
    intervals = {name: latex(table, name, "interval", has_notes=False) for name, table in _intervals(tables)}
    texts |= {f"tables/{name}.tex": text for name, text in intervals.items()}
    given = {"tables": told, "forms": "", "intervals": list(intervals)} | _run(tables) | _reproduced(tables)
    for table in tables:
        if (figure := stored_forms_figure(table, artefacts)) is not None:
            figures["figures/forms.pdf"] = as_file(figure, ".pdf")
            given["forms"] = table.data_title
            break
    said = [(_stem(table), notes(table, reasons=False)) for table in tables]
    given["notes"] = [Latex(appendix(stem, lines)) for stem, lines in said if lines]
    for name in ("protocol", "results", "statistics", "appendix"):
        texts[f"{name}.tex"] = ENVIRONMENT.get_template(f"{name}.tex").render(given)
    texts = {name: unicodedata.normalize("NFC", text) for name, text in texts.items()}
    texts["characters.tex"] = characters("".join(texts.values()))
    texts["paper.tex"] = ENVIRONMENT.get_template(f"{template}.tex").render()
    texts["references.bib"] = bibliography()
    for name in ("statistics.bib", "Makefile"):
        texts[name] = resources.files("benchmark.report.paper").joinpath(f"templates/{name}").read_text("utf-8")
    return {name: text.encode("utf-8") for name, text in texts.items()} | figures


def characters(text: str) -> str:
    """Return declarations of the characters of a text that LaTeX does not know: as their letter, or as their number."""
    lines = ["% What stands for characters that the fonts lack; with other fonts, change it."]
    for character in sorted(set(text)):
        if not (character.isascii() or character in _KNOWN or _is_composed(character)):
            letter = unicodedata.normalize("NFKD", character)[0]
            shown = letter if letter.isascii() and letter.isalnum() else f"[U+{ord(character):04X}]"
            lines.append(rf"\DeclareUnicodeCharacter{{{ord(character):04X}}}{{{shown}}}")
    return "\n".join(lines) + "\n"


def _is_composed(character: str) -> bool:
    """Return whether LaTeX makes a letter of another one and an accent above, or a cedilla."""
    parts = unicodedata.normalize("NFD", character)
    return character < "\u0180" and len(parts) == 2 and (parts[1] in _ABOVE or parts in _CEDILLAS)


def _stem(table: TableContent) -> Latex:
    """Return the name of the files of a table, and of its label: LaTeX takes all that is in it."""
    name = table.file_stem
    return Latex(name if name.isascii() else f"{name.encode('ascii', 'ignore').decode()}-{digest(name)[:8]}")


def _table(table: TableContent, figure: str) -> dict[str, Any]:
    """Facts about one table."""
    complete, lacking = facts.coverage(table)
    own = table.is_own or table.identifier == table.data["name"]
    return {
        "table": table,
        "stem": _stem(table),
        "heading": table.caption if own else f"{table.caption} ({table.data['name']})",
        "in_paper": table.has_paper,
        "source": Latex(data_source(table)),
        "figure": Latex(figure),
        "leads": facts.leads(table, MEASURE),
        "n_cells": len(facts.cells(table)),
        "n_complete": complete,
        "lacking": lacking,
    }


def _run(tables: Sequence[TableContent]) -> dict[str, Any]:
    """Facts about the jobs of all tables together."""
    made = facts.records(tables)
    dates = sorted(str(record.get("finished", ""))[:10] for record in made) or ["", ""]
    cells = [cell for table in tables for _, _, cell in facts.cells(table)]
    return {
        "inputs": [input_ for input_ in INPUTS if any(input_ in table.inputs for table in tables)],
        "n_vertices": N_VERTICES,
        "size": SIZE,
        "in_paper": any(table.has_paper for table in tables),
        "n_methods": len({record["method"] for record in made}),
        "n_jobs": len(made),
        "repeats": any(cell.repeats for cell in cells),
        "scorers": [
            Latex(text) for text in dict.fromkeys(scorer_cited(t) or latex_prose(t.scorer_title) for t in tables)
        ],
        "seeds": sorted({str(table.seed) for table in tables}),
        "own": facts.own_methods(tables),
        "n_departing": len({text for table in tables for text in table.departures.values()}),
        "n_models": len({model["digest"] for record in made for model in record.get("models", ())}),
        "most": _MOST_NAMED,
        "dates": (dates[0], dates[-1]),
        "versions": facts.versions(made),
        "suite": __version__,
        "outdated": sum(bool(cell.outdated) for cell in cells),
        "draws": DRAWS,
        "resamples": RESAMPLES,
        "tolerance": TOLERANCE,
        "agreeing": AGREEING,
    }


def _reproduced(tables: Sequence[TableContent]) -> dict[str, Any]:
    """Return how many figures of the paper got which outcome, and what of its claims can be judged."""
    figures = reproduced_figures(tables).dropna(subset="ours")
    by_table = figures.groupby(["table", "input"], sort=False)["outcome"]
    counts = {place: Counter(outcomes) for place, outcomes in by_table}
    names = [name for name in OUTCOMES if any(found[name] for found in counts.values())]
    claims = assess_claims(paper_tables(tables)) if counts else []
    return {
        "outcomes": names,
        "reproduction": [(*place, [found[name] for name in names]) for place, found in counts.items()],
        "claims": [each for each in claims if each.n_comparisons],
    }


def _intervals(tables: Iterable[TableContent]) -> Iterable[tuple[str, TableContent]]:
    """Name and content of the tables of intervals, one for each input."""
    for table in tables:
        caption = f"{table.table.caption}, with intervals"
        for input_ in table.inputs:
            rows = [row for row in table.rows if input_ in row.cells and row.cells[input_].scores]
            if rows:
                shown = replace(
                    table,
                    table=replace(table.table, caption=caption),
                    inputs=(input_,),
                    rows=tuple(
                        replace(row, paper=None, departs="", cells={input_: _plain(row.cells[input_])}) for row in rows
                    ),
                )
                yield Latex(f"intervals-{_stem(table)}-{input_}"), shown


def _plain(cell: Cell) -> Cell:
    """Return a cell without its spread, which stands in the table itself."""
    return replace(cell, deviation=None)
