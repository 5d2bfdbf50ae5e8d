"""Tables I to IV as printed in the paper, its claims, and the sources of methods and data.

"Deep Learning for Canonical Reconstruction of Deformable Objects from Depth Images in Robotic Vision and SLAM-Aware
Perception": nearest neighbour (NN), first tier (FT), second tier (ST), discounted cumulative gain (DCG). The row titles
are the paper's. The paper does not say which input its baselines had.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import cache
from importlib import resources

from benchmark.api.contracts import Input

MEASURES = ("NN", "FT", "ST", "DCG")
"""The measures that the paper prints, in its order."""

SCHEDULE = "500 x 500 pixels, 500 epochs, batch 8, about three days on one RTX 4090"
"""Training schedule of the paper."""


@dataclass(frozen=True)
class PaperRow:
    """One row of a table.

    Parameters
    ----------
    method
        Name of the method of the suite for this row.
    title
        Title as printed.
    values
        Values by table and measure.
    """

    method: str
    title: str
    values: dict[str, dict[str, float]]


def _row(method: str, title: str, *tables: str, **named: str) -> PaperRow:
    """Parse "NN FT ST DCG" for Tables I, II and III, or for a table given by its numeral."""
    printed = dict(zip(("I", "II", "III"), tables, strict=False)) | named
    values = {table: dict(zip(MEASURES, map(float, row.split()), strict=True)) for table, row in printed.items()}
    return PaperRow(method, title, values)


# fmt: off
ROWS: tuple[PaperRow, ...] = (
    _row("classic-mds", "Classic MDS", ".10 .22 .39 .54", ".01 .03 .07 .28", ".74 .54 .80 .80"),
    _row("fast-mds", "Fast MDS", ".14 .20 .35 .53", ".00 .02 .04 .27", ".73 .52 .77 .77"),
    _row("non-metric-mds", "Non-metric MDS", ".09 .24 .41 .55", ".02 .04 .08 .30", ".76 .67 .87 .85"),
    _row("least-squares-mds", "Least Square MDS", ".01 .13 .31 .45", ".00 .00 .01 .26", ".79 .63 .86 .84"),
    _row("constrained-mds", "Constrained MDS", ".04 .14 .25 .46", ".00 .01 .03 .27", ".88 .71 .89 .89"),
    _row("gps", "GPS", ".40 .20 .32 .56", ".07 .06 .12 .33", ".71 .52 .72 .76"),
    _row("mesh-unfolding", "Mesh Unfolding", ".04 .18 .34 .49", ".00 .01 .03 .28", ".88 .65 .86 .85"),
    _row("skeleton", "Skeleton-based", ".01 .14 .32 .46", ".01 .01 .02 .27", ".78 .62 .85 .84"),
    _row("learned", "Our", ".61 .53 .73 .78", ".10 .09 .10 .41", ".97 .82 .89 .93"),
)

ABLATION: tuple[PaperRow, ...] = (
    _row("learned-strict", "strict train", IV=".56 .49 .66 .73"),
    _row("learned-without-srf", "w/o SRF", IV=".58 .51 .68 .76"),
    _row("learned-without-lrf", "w/o LRF", IV=".56 .50 .64 .71"),
    _row("learned", "Our", IV=".61 .53 .73 .78"),
)
# fmt: on


#: Tables for which the paper prints figures.
NUMERALS = tuple(sorted({table for row in (*ROWS, *ABLATION) for table in row.values}))


def rows(table: str) -> dict[str, PaperRow]:
    """Return the rows of a table by method, in the order of the paper; empty for a table that is not in the paper."""
    return {row.method: row for row in (*ROWS, *ABLATION) if table in row.values}


def is_learned(method: str) -> bool:
    """Return whether a row of the paper is a network, which sees only depth images."""
    return method.startswith("learned")


@dataclass(frozen=True)
class Claim:
    """Claim that one row scores higher than others.

    Parameters
    ----------
    words
        The claim as a sentence.
    table
        Table that supports it.
    better
        Row that should score higher.
    others
        Rows that should score lower.
    input
        Input of the methods.
    measures
        Measures to compare.
    """

    words: str
    table: str
    better: str
    others: tuple[str, ...]
    input: Input = "view"
    measures: tuple[str, ...] = MEASURES


CLASSICAL = tuple(row.method for row in ROWS if not is_learned(row.method))

#: Claims, by measures for which the paper's own figures support them: in Table II the ST of its network is below that
#: of GPS, in Table III it equals that of Constrained MDS.
CLAIMS: tuple[Claim, ...] = (
    Claim("The network finds more than every classical form on synthetic humans.", "I", "learned", CLASSICAL),
    Claim(
        "It finds more than every classical form on real humans (NN, FT, DCG).",
        "II",
        "learned",
        CLASSICAL,
        measures=("NN", "FT", "DCG"),
    ),
    Claim(
        "It finds more than every classical form on TOSCA (NN, FT, DCG).",
        "III",
        "learned",
        CLASSICAL,
        measures=("NN", "FT", "DCG"),
    ),
    Claim("Short-range features help.", "IV", "learned", ("learned-without-srf",)),
    Claim("Long-range features help.", "IV", "learned", ("learned-without-lrf",)),
    Claim("Progressive weighting of the losses helps.", "IV", "learned", ("learned-without-weighting",)),
    Claim("Poses that were seen in training are found better than unseen ones.", "IV", "learned", ("learned-strict",)),
    Claim(
        "Of the classical forms GPS has the highest NN on synthetic humans.",
        "I",
        "gps",
        tuple(name for name in CLASSICAL if name != "gps"),
        measures=("NN",),
    ),
)


#: Combining characters for the accents of TeX.
_ACCENTS = {"'": "\u0301", "`": "\u0300", "^": "\u0302", '"': "\u0308", "~": "\u0303", "u": "\u0306", "v": "\u030c",
            "c": "\u0327", "=": "\u0304", ".": "\u0307", "H": "\u030b", "r": "\u030a"}  # fmt: skip


def source_of(key: str) -> str:
    """Return authors, year, title and source of an entry of the bibliography as text, or the key if there is none."""
    match = re.search(rf"@\w+\{{{re.escape(key)},(.*?)\n\}}", _bibliography(), re.DOTALL) if key else None
    if match is None:
        return key
    body = re.sub(r"\n(?!\s*\w+\s*=)\s*", " ", match[1])  # one field per line
    fields = {name: _as_text(text) for name, text in re.findall(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", body, re.MULTILINE)}
    *others, last = re.split(r"\s+and\s+", fields.get("author", ""))
    named = f"{', '.join(others)} and {last}" if others else last
    if year := fields.get("year"):
        named = f"{named} ({year})".strip()
    place = next((fields[name] for name in ("journal", "booktitle", "publisher", "note") if name in fields), "")
    return ". ".join(filter(None, (named, fields.get("title", ""), place)))


def is_listed(key: str) -> bool:
    """Return whether the bibliography has an entry with this key."""
    return bool(key) and f"{{{key},\n" in _bibliography()


@cache
def _bibliography() -> str:
    return resources.files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def _as_text(tex: str) -> str:
    """Return the text of a field with accented characters and without braces."""
    tex = re.sub(r"""\\(['`^"~=.]|[uvcHr](?=[{\s]))\s*\{?\\?([A-Za-z])\}?""", _accented, tex)
    tex = re.sub(r"\\([&%_#$])", r"\1", tex).replace("--", "\u2013").replace("~", " ")
    return re.sub(r"[{}]", "", tex)


def _accented(match: re.Match[str]) -> str:
    return unicodedata.normalize("NFC", match[2] + _ACCENTS[match[1]])
