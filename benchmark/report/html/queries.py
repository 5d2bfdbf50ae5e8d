"""Data of the browser of queries: every shape, its scores, and its nearest shapes under each method, in parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.api.contracts import Input
from benchmark.pipeline.storage.records import answered_shapes
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.html.measured import Ranked, poses_of
from benchmark.report.html.scripts import Files, add_script
from benchmark.report.html.thumbnails import ACROSS, DOWN, Sheets, spread
from benchmark.text import brief
from retrieval.measures import PRINTED

#: Queries in one script.
PART = 100

#: Bytes that one query of one method takes, about, and that those of one table may take together.
_EACH, MOST_BYTES = 100, 6_000_000


def write_queries(
    stem: str,
    ranked: Sequence[Ranked],
    titles: Mapping[str, str],
    pictures: Mapping[Input, Sheets],
    artefacts: ArtefactReader,
    files: Files,
) -> dict[str, Any]:
    """Write the scripts of the browser of one table: of large galleries so many queries, evenly spread, as may be.

    Parameters
    ----------
    stem
        Name of the files.
    ranked
        Methods with their rankings.
    titles
        Of the methods, in the order in which they are shown.
    pictures
        Of the shapes and of their forms, by input.
    artefacts
        Where poses are.
    files
        Where they are added.

    Returns
    -------
    dict
        What the page reads first: galleries with their shapes and parts.
    """
    galleries: list[dict[str, Any]] = []
    order = {method: number for number, method in enumerate(titles)}
    places = list(dict.fromkeys((each.record["gallery"], each.input) for each in ranked))
    room = max(PART, int(MOST_BYTES / max(len(places), 1) / max(len(titles), 1) / _EACH))
    for number, (gallery, input_) in enumerate(places):
        here = [each for each in ranked if (each.record["gallery"], each.input) == (gallery, input_)]
        here.sort(key=lambda each: order[each.method])
        labels: dict[str, str] = {}
        for each in here:
            labels |= zip(each.record["shapes"], each.record["labels"], strict=True)
        names = list(labels)
        pose_of = poses_of(here[0].record, artefacts)
        chosen = spread(range(len(names)), room)
        for part in range(0, len(chosen), PART):
            queries = [names[k] for k in chosen[part : part + PART]]
            add_script(files, f"queries-{stem}-{number}-{part // PART}", _part(here, names, queries))
        sheets = pictures.get(input_, Sheets(""))
        galleries.append(
            {
                "gallery": gallery,
                "input": input_,
                "number": number,
                "names": names,
                "subjects": list(labels.values()),
                "poses": [pose_of.get(name, "") for name in names],
                "sheets": sheets.stem,
                "pictures": [sheets.places.get(name, -1) for name in names],
                "queries": chosen if len(chosen) < len(names) else None,
                "methods": [_method(each, titles[each.method], names, sheets) for each in here],
            }
        )
    fixed = {"part": PART, "across": ACROSS, "down": DOWN, "measures": list(PRINTED)}
    return {"stem": stem, **fixed, "galleries": galleries}


def _method(ranked: Ranked, title: str, names: Sequence[str], sheets: Sheets) -> dict[str, Any]:
    """A method, the number of its sheets, and by reason the shapes without a picture of their form."""
    told = sheets.told.get(ranked.method, {}) | {name: brief(why) for name, why in ranked.record["unsupported"]}
    missing: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        if why := told.get(name, "not kept here"):
            missing.setdefault(why, []).append(k)
    number = sheets.numbers.get(ranked.method, 0)
    return {"name": ranked.method, "title": title, "sheet": number, "missing": missing}


def _part(ranked: Sequence[Ranked], names: Sequence[str], queries: Sequence[str]) -> dict[str, Any]:
    """By method, for each query: its nearest shapes by their place in the gallery, and its scores; None if left out."""
    place = {name: k for k, name in enumerate(names)}
    found: dict[str, Any] = {}
    for each in ranked:
        record = each.record
        own = {name: k for k, name in enumerate(record["shapes"])}
        answered = answered_shapes(record)
        ranked_at = {name: k for k, name in enumerate(answered)}
        to_gallery = [place[name] for name in answered]
        nearest: list[list[int] | None] = []
        scores: list[list[float | None] | None] = []
        for query in queries:
            k, at = own.get(query), ranked_at.get(query)
            matches = None if each.ranking is None or at is None else each.ranking.nearest[at]
            nearest.append(None if matches is None else [to_gallery[match] for match in matches])
            scores.append(None if k is None else [record["per_query"][name][k] for name in PRINTED])
        found[each.method] = {"nearest": nearest if each.ranking is not None else None, "scores": scores}
    return found
