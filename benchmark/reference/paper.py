"""Tables I to IV as printed in the paper, its claims, and the sources of methods and data.

"Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic
Vision and SLAM-Aware Perception": nearest neighbour (NN), first tier (FT), second tier (ST),
discounted cumulative gain (DCG). The paper does not say which input its baselines had.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from importlib import resources
from inspect import cleandoc

PAPER_MEASURES = ("NN", "FT", "ST", "DCG")
"""The measures that the paper prints, in its order."""

AS_PRINTED = "learned[configuration=as_printed]"
"""The network with the paper's pixels and epochs, whose row bears the paper's name."""


def _table(text: str) -> dict[str, dict[str, float]]:
    """Parse lines of a method and "NN FT ST DCG"."""
    rows = (line.rsplit(maxsplit=4) for line in text.strip().splitlines())
    return {
        name.strip(): dict(zip(PAPER_MEASURES, map(float, figures), strict=True))
        for name, *figures in rows
    }


PRINTED: dict[str, dict[str, dict[str, float]]] = {
    "I": _table(f"""
        classic-mds        .10 .22 .39 .54
        fast-mds           .14 .20 .35 .53
        non-metric-mds     .09 .24 .41 .55
        least-squares-mds  .01 .13 .31 .45
        constrained-mds    .04 .14 .25 .46
        gps                .40 .20 .32 .56
        mesh-unfolding     .04 .18 .34 .49
        skeleton           .01 .14 .32 .46
        {AS_PRINTED}       .61 .53 .73 .78"""),
    "II": _table(f"""
        classic-mds        .01 .03 .07 .28
        fast-mds           .00 .02 .04 .27
        non-metric-mds     .02 .04 .08 .30
        least-squares-mds  .00 .00 .01 .26
        constrained-mds    .00 .01 .03 .27
        gps                .07 .06 .12 .33
        mesh-unfolding     .00 .01 .03 .28
        skeleton           .01 .01 .02 .27
        {AS_PRINTED}       .10 .09 .10 .41"""),
    "III": _table(f"""
        classic-mds        .74 .54 .80 .80
        fast-mds           .73 .52 .77 .77
        non-metric-mds     .76 .67 .87 .85
        least-squares-mds  .79 .63 .86 .84
        constrained-mds    .88 .71 .89 .89
        gps                .71 .52 .72 .76
        mesh-unfolding     .88 .65 .86 .85
        skeleton           .78 .62 .85 .84
        {AS_PRINTED}       .97 .82 .89 .93"""),
    "IV": _table("""
        learned-strict       .56 .49 .66 .73
        learned-without-srf  .58 .51 .68 .76
        learned-without-lrf  .56 .50 .64 .71
        learned              .61 .53 .73 .78"""),
}
"""Figures by table, method of the suite, and measure, in the order of the paper."""

NUMERALS = tuple(PRINTED)

#: The classical methods of the paper.
CLASSICAL = tuple(PRINTED["III"])[:-1]

#: The paper's network as printed, and at 128 x 128 pixels; a claim about the network is judged for
#: each.
PAPERS_NETWORKS = (AS_PRINTED, "learned")


@dataclass(frozen=True)
class Claim:
    """Claim that one row scores higher than others.

    Parameters
    ----------
    words
        The claim as a sentence.
    table
        Table that supports it.
    better, others
        Rows that should score higher, and lower.
    measures
        Measures to compare: those for which the paper's own figures support the claim.
    """

    words: str
    table: str
    better: str
    others: tuple[str, ...]
    measures: tuple[str, ...] = PAPER_MEASURES


_WITHOUT_ST = ("NN", "FT", "DCG")

CLAIMS: tuple[Claim, ...] = (
    *(
        Claim("The network scores above all classical forms.", "I", name, CLASSICAL)
        for name in PAPERS_NETWORKS
    ),
    *(
        Claim("The network scores above all classical forms.", "II", name, CLASSICAL, _WITHOUT_ST)
        for name in PAPERS_NETWORKS
    ),
    *(
        Claim("The network scores above all classical forms.", "III", name, CLASSICAL, _WITHOUT_ST)
        for name in PAPERS_NETWORKS
    ),
    Claim("Short-range features help.", "IV", "learned", ("learned-without-srf",)),
    Claim("Long-range features help.", "IV", "learned", ("learned-without-lrf",)),
    Claim(
        "Progressive weighting of the losses helps.",
        "IV",
        "learned",
        ("learned-without-weighting",),
    ),
    Claim(
        "Shapes in poses seen in training are retrieved better.",
        "IV",
        "learned",
        ("learned-strict",),
    ),
    Claim(
        "GPS has the highest NN of the classical forms.",
        "I",
        "gps",
        tuple(name for name in CLASSICAL if name != "gps"),
        ("NN",),
    ),
)


#: Beginning of a BibTeX entry, with its key; a field; and commands beyond accents, which no entry
#: from outside needs.
_HEAD = re.compile(
    r"@(?!comment|preamble|string)[a-z]+\s*\{\s*([\w:./+-]+)\s*,", re.IGNORECASE | re.ASCII
)
_FIELD = re.compile(
    r"(\w+)\s*=\s*(?:\{((?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*)\}|\"([^\"]*)\"|(\d+))"
)
_COMMAND = re.compile(r"\\(?!url\b|emph\b)[A-Za-z]{3,}|\^\^")  # ^^5c is a backslash


def source_of(cite: str) -> str:
    """Return a citation as text, such as "A. Author and B. Author (2014). Title. Journal".

    Parameters
    ----------
    cite
        A BibTeX entry, or the key of one in the bibliography. A text that is neither is returned.
    """
    _, entry = entry_of(cite)
    fields = {}
    for name, *texts in _FIELD.findall(entry):  # in braces, in quotes, or a number
        text = re.sub(r"[{}\\]", "", "".join(texts)).replace("--", "\u2013")
        fields[name] = " ".join(text.split())
    authors = fields.get("author", "").split(" and ")
    named = authors[-1]
    if len(authors) > 1:
        named = f"{', '.join(authors[:-1])} and {authors[-1]}"
    if fields.get("year"):
        named = f"{named} ({fields['year']})".strip()
    source = ""
    for name in ("journal", "booktitle", "publisher", "note"):
        if name in fields:
            source = fields[name]
            break
    return ". ".join(filter(None, (named, fields.get("title", ""), source))) or cite


def entry_of(cite: str) -> tuple[str, str]:
    """Return the key and the text of a BibTeX entry.

    Parameters
    ----------
    cite
        The entry itself, or its key in the bibliography.

    Returns
    -------
    key, entry : str
        Both are "" if it is no whole entry, or has commands of TeX that could do harm.
    """
    entry = _entries_of_bibliography().get(cite, cleandoc(cite)).strip()
    head = _HEAD.match(entry)
    if head is None or not _is_closed_at_end(entry) or _COMMAND.search(entry):
        return "", ""
    return head[1], entry


def _entries_of_bibliography() -> dict[str, str]:
    """Return the entries of the bibliography by key."""
    entries = {}
    for entry in bibliography().split("\n\n"):
        head = _HEAD.match(entry)
        if head:
            entries[head[1]] = entry
    return entries


def _is_closed_at_end(entry: str) -> bool:
    """Return whether the first brace of a text is closed by its last character."""
    depth = 0
    for position, character in enumerate(entry):
        if character == "{":
            depth += 1
        elif character == "}":
            depth -= 1
            if depth == 0:
                return position == len(entry) - 1
    return False


@cache
def bibliography() -> str:
    """Return the BibTeX file of the sources of methods, scorers and data."""
    return (
        resources.files("benchmark.reference")
        .joinpath("references.bib")
        .read_text(encoding="utf-8")
    )
