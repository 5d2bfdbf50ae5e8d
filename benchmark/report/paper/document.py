"""Files of a paper, from templates whose environment escapes all values."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import resources
from typing import Any, Literal, get_args

from benchmark import __version__
from benchmark.geometry.depth import SIZE
from benchmark.pipeline.stages.shapes import N_VERTICES
from benchmark.pipeline.storage.environment import versions_in
from benchmark.pipeline.storage.keys import digest
from benchmark.plugins.registry import BUILT_IN
from benchmark.protocols.tables import INPUTS
from benchmark.reference.paper import NUMERALS
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.escaping import latex_prose
from benchmark.report.formats import bibliography
from benchmark.report.latex import ENVIRONMENT, Latex, appendix, data_source, latex, scorer_cited
from benchmark.report.notes import notes
from benchmark.report.pictures.charts import MEASURE, scores_figure
from benchmark.report.pictures.forms import stored_forms_figure
from benchmark.report.pictures.painting import as_file
from benchmark.report.reproduction import AGREEING, OUTCOMES, TOLERANCE, assess_claims, paper_tables, reproduced_figures
from benchmark.report.significance import DRAWS, RESAMPLES

Template = Literal["article", "ieee"]
"""Document classes of a paper."""

TEMPLATES: tuple[Template, ...] = get_args(Template)

#: Width of the text in inches, by template.
_INCHES = {"article": 6.45, "ieee": 7.1}

#: Maximum number of incomplete rows named individually.
_MOST_NAMED = 12

#: Characters, in addition to composed Latin letters, in the oldest encoding of LaTeX.
_KNOWN = frozenset("\u00a0¡£§©¬®°±²³µ¶·¹¼½¾¿ÆØæßøıŁłŒœ\u2010\u2011\u2012–—―‘’“”†‡•…‰€™")

#: Accents, and letters with a cedilla, that LaTeX composes.
_ABOVE = frozenset("\u0300\u0301\u0302\u0303\u0304\u0306\u0307\u0308\u030a\u030b\u030c")
_CEDILLAS = frozenset(f"{letter}\u0327" for letter in "CcSsTt")


def main_tables(tables: Sequence[TableContent]) -> list[TableContent]:
    """Return the tables of the paper, for the official data or otherwise the stand-in, and those of private data."""
    chosen: dict[str, TableContent] = {}
    for table in tables:
        known = chosen.get(table.identifier)
        if table.identifier in NUMERALS and not table.is_own and (known is None or known.data["stand_in_for"]):
            chosen[table.identifier] = table
    return [*chosen.values(), *(table for table in tables if table.is_own)] or list(tables)


def paper_files(tables: Sequence[TableContent], artefacts: ArtefactReader, template: Template) -> dict[str, bytes]:
    """Return all files of a paper by name.

    Parameters
    ----------
    tables
        Tables of the paper.
    artefacts
        Reader of stored canonical forms; without them, there is no figure of forms.
    template
        Document class of the paper.
    """
    figures = {f"scores-{_stem(t)}.pdf": scores_figure(t, _INCHES[template]) for t in tables}
    with_forms = ((table, stored_forms_figure(table, artefacts)) for table in tables)
    forms_of, figures["forms.pdf"] = next(((t, drawn) for t, drawn in with_forms if drawn), (None, None))
    pictures = {f"figures/{name}": as_file(figure, ".pdf") for name, figure in figures.items() if figure}
    texts = {f"tables/{_stem(table)}.tex": latex(table, _stem(table), has_notes=False) for table in tables}
    intervals = {name: latex(table, name, "interval", has_notes=False) for name, table in _intervals(tables)}
    texts |= {f"tables/{name}.tex": text for name, text in intervals.items()}
    with_notes = [(_stem(table), notes(table, reasons=False)) for table in tables]
    content = {
        "tables": [_table(table, has_figure=f"figures/scores-{_stem(table)}.pdf" in pictures) for table in tables],
        "forms": forms_of.data_title if forms_of else "",
        "intervals": list(intervals),
        "notes": [Latex(appendix(stem, lines)) for stem, lines in with_notes if lines],
        **_run(tables),
        **_reproduced(tables),
    }
    for name in ("protocol", "results", "statistics", "appendix"):
        texts[f"{name}.tex"] = ENVIRONMENT.get_template(f"{name}.tex").render(content)
    texts = {name: unicodedata.normalize("NFC", text) for name, text in texts.items()}
    texts["characters.tex"] = characters("".join(texts.values()))
    texts["paper.tex"] = ENVIRONMENT.get_template(f"{template}.tex").render()
    texts["references.bib"] = bibliography()
    for name in ("statistics.bib", "Makefile"):
        texts[name] = resources.files("benchmark.report.paper").joinpath(f"templates/{name}").read_text("utf-8")
    return {name: text.encode("utf-8") for name, text in texts.items()} | pictures


def characters(text: str) -> str:
    """Return LaTeX declarations that replace unknown characters in a text by their base letter or code point."""
    lines = ["% What stands for characters that the fonts lack; with other fonts, change it."]
    for character in sorted(set(text)):
        if not (character.isascii() or character in _KNOWN or _is_composed(character)):
            letter = unicodedata.normalize("NFKD", character)[0]
            shown = letter if letter.isascii() and letter.isalnum() else f"[U+{ord(character):04X}]"
            lines.append(rf"\DeclareUnicodeCharacter{{{ord(character):04X}}}{{{shown}}}")
    return "\n".join(lines) + "\n"


def _is_composed(character: str) -> bool:
    """Return whether LaTeX composes a letter from another one with an accent or a cedilla."""
    parts = unicodedata.normalize("NFD", character)
    return character < "\u0180" and len(parts) == 2 and (parts[1] in _ABOVE or parts in _CEDILLAS)


def _stem(table: TableContent) -> Latex:
    """Return a name accepted by LaTeX for the files and the label of a table."""
    name = table.file_stem
    return Latex(name if name.isascii() else f"{name.encode('ascii', 'ignore').decode()}-{digest(name)[:8]}")


def _table(table: TableContent, *, has_figure: bool) -> dict[str, Any]:
    """Return the facts about one table."""
    lines = [line for line in table.lines if line.status != "missing"]
    lacking = [
        (line.title, line.input, f"{line.coverage:.1%} of the shapes" if line.scores else f"none ({line.status})")
        for line in lines
        if line.coverage < 1
    ]
    own = table.is_own or table.identifier == table.data["name"]
    return {
        "table": table,
        "stem": _stem(table),
        "heading": table.caption if own else f"{table.caption} ({table.data['name']})",
        "in_paper": table.has_paper,
        "source": Latex(data_source(table)),
        "figure": Latex(f"scores-{_stem(table)}.pdf" if has_figure else ""),
        "leads": leads(table, MEASURE),
        "n_cells": len(lines),
        "n_complete": len(lines) - len(lacking),
        "lacking": lacking,
    }


def leads(table: TableContent, measure: str) -> list[dict[str, Any]]:
    """Return the best complete row by a measure for each input, without controls.

    Returns
    -------
    list of dict
        ``input``; ``title``, ``score``, and ``low`` and ``high``, the ends of its interval; ``n_others``, the number of
        rows tested against it, without those whose first ranks tie; and ``inseparable``, the titles of rows that do not
        differ significantly.
    """
    leaders = []
    for input_ in table.inputs:
        lines = [line for line in table.lines if line.input == input_]
        judged = [(row, table.judged(row)[measure]) for row in lines if table.judged(row)]
        others = [(row, one) for row, one in judged if one.probability is not None and not one.is_tied]
        for row, best in [(row, one) for row, one in judged if one.is_best][:1]:
            leaders.append(
                {
                    "input": input_,
                    "title": row.title,
                    "score": row.scores[measure],
                    "low": best.low,
                    "high": best.high,
                    "n_others": len(others),
                    "inseparable": [row.title for row, one in others if one.is_inseparable],
                }
            )
    return leaders


def _run(tables: Sequence[TableContent]) -> dict[str, Any]:
    """Return the facts about the jobs of all tables."""
    lines = [line for table in tables for line in table.lines]
    records = list({record["key"]: record for line in lines for record in line.records}.values())
    dates = sorted(str(record.get("finished", ""))[:10] for record in records) or [""]
    scorers = dict.fromkeys(scorer_cited(t) or latex_prose(t.scorer_title) for t in tables)
    return {
        "inputs": [input_ for input_ in INPUTS if any(input_ in table.inputs for table in tables)],
        "n_vertices": N_VERTICES,
        "size": SIZE,
        "in_paper": any(table.has_paper for table in tables),
        "n_methods": len({record["method"] for record in records}),
        "n_jobs": len(records),
        "repeats": False,
        "scorers": [Latex(text) for text in scorers],
        "seeds": sorted({str(table.seed) for table in tables}),
        "own": list(dict.fromkeys(line.title for line in lines if line.method.partition("[")[0] not in BUILT_IN)),
        "n_departing": len({text for table in tables for text in table.departures.values()}),
        "n_models": len({model["digest"] for record in records for model in record.get("models", ())}),
        "most": _MOST_NAMED,
        "dates": (dates[0], dates[-1]),
        "versions": _versions(records),
        "suite": __version__,
        "outdated": sum(bool(line.outdated) for line in lines),
        "draws": DRAWS,
        "resamples": RESAMPLES + 1,
        "tolerance": TOLERANCE,
        "agreeing": AGREEING,
    }


def _versions(records: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Return the versions of system and packages in some records, with all of them if they differ."""
    versions: dict[str, set[str]] = {}
    for record in records:
        for part in record.get("environments", ()):
            for name, version in versions_in(str(part.get("environment", "{}"))).items():
                versions.setdefault(name, set()).add(str(version))
    return {name: " and ".join(sorted(values)) for name, values in versions.items()}


def _reproduced(tables: Sequence[TableContent]) -> dict[str, Any]:
    """Return the counts of outcomes of the paper's scores, and the outcomes of its claims."""
    figures = reproduced_figures(tables).dropna(subset="ours")
    by_table = figures.groupby(["table", "input"], sort=False)["outcome"]
    counts = {place: Counter(outcomes) for place, outcomes in by_table}
    names = [name for name in OUTCOMES if any(of_input[name] for of_input in counts.values())]
    claims = assess_claims(paper_tables(tables)) if counts else []
    return {
        "outcomes": names,
        "reproduction": [(*place, [of_input[name] for name in names]) for place, of_input in counts.items()],
        "claims": [claim for claim in claims if claim.n_comparisons],
    }


def _intervals(tables: Iterable[TableContent]) -> Iterable[tuple[Latex, TableContent]]:
    """Yield names and contents of the tables of intervals, one for each input."""
    for table in tables:
        caption = f"{table.table.caption}, with intervals"
        for input_ in table.inputs:
            frame = table.frame[(table.frame["input"] == input_) & table.frame["scores"].notna()]
            if len(frame):
                frame = frame.assign(deviation=None, paper=None, departs="")
                shown = replace(table, table=replace(table.table, caption=caption), inputs=(input_,), frame=frame)
                yield Latex(f"intervals-{_stem(table)}-{input_}"), shown
