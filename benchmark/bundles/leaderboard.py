"""The page of all bundles of a folder: what of them was verified here, apart from what is claimed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from jinja2 import ChoiceLoader, PackageLoader

from benchmark.bundles.checking import Request, digest_of_file, verify
from benchmark.bundles.outcome import Outcome, RowOutcome
from benchmark.errors import BenchmarkError, ConfigurationError
from benchmark.pipeline.storage.environment import in_words
from benchmark.pipeline.storage.keys import digest
from benchmark.report.html.folder import Folder
from benchmark.report.html.pages import ENVIRONMENT
from benchmark.report.rounding import number
from benchmark.source_code import text_of
from retrieval.measures import PRINTED

#: Digits of a digest in the address of a row.
_SHORT = 12

_ENVIRONMENT = ENVIRONMENT.overlay(
    loader=ChoiceLoader([PackageLoader("benchmark.bundles"), PackageLoader("benchmark.report.html")])
)


@dataclass(frozen=True)
class Bundle:
    """A bundle on the page.

    Parameters
    ----------
    file
        Its name in the folder.
    outcome
        What was found.
    """

    file: str
    outcome: Outcome

    @property
    def anchor(self) -> str:
        """Place on the page."""
        return f"bundle-{self.outcome.digest[:_SHORT]}"

    @property
    def address(self) -> str:
        """File that tells all that was found."""
        return outcome_file(self.outcome.digest)

    @property
    def versions(self) -> str:
        """Versions that it tells, as a line."""
        return in_words(dict(self.outcome.versions))


@dataclass(frozen=True)
class BoardRow:
    """A row: a record of a bundle."""

    of: Bundle
    found: RowOutcome

    @property
    def anchor(self) -> str:
        """Place on the page, the same for as long as the bundle is."""
        return f"row-{self.of.outcome.digest[:_SHORT]}-{self.found.key[:_SHORT]}"

    @property
    def bundle(self) -> str:
        """Place of its bundle."""
        return self.of.anchor

    @property
    def title(self) -> str:
        """Name in tables."""
        return self.of.outcome.title

    @property
    def method(self) -> str:
        """Name on the command line."""
        return self.of.outcome.method

    @property
    def author(self) -> str:
        """Name of its author."""
        return self.of.outcome.author

    def interval(self, name: str) -> str:
        """Ends of the interval of a measure."""
        low, high = self.found.intervals[name]
        return f"{number(low)} to {number(high)}"

    @property
    def seconds(self) -> str:
        """Seconds of a shape."""
        return "" if self.found.seconds is None else f"{self.found.seconds:.3g}"

    @property
    def memory(self) -> str:
        """Peak memory."""
        return "" if self.found.peak_mib is None else f"{self.found.peak_mib:.0f}"

    @property
    def trained_on(self) -> str:
        """Training data."""
        return ", ".join(self.found.trained_on) or "nothing"

    @property
    def evidence(self) -> str:
        """Origin of its scores, in words."""
        found = self.found
        if found.faults:
            return "; ".join(f"{fault.name}: {fault.problem}" for fault in found.faults)
        compared = {"data": "labels and inputs compared with the data", "records": "labels and inputs as in records"}
        again = f"{len(found.again) or 'none'} made again"
        return f"from {found.holds}; {again}; {compared.get(found.compared, 'labels and inputs as told')}"


@dataclass(frozen=True)
class Board:
    """The rows of one gallery."""

    rows: tuple[BoardRow, ...]

    @property
    def _first(self) -> RowOutcome:
        return self.rows[0].found

    @property
    def anchor(self) -> str:
        """Place on the page."""
        return f"gallery-{digest(list(_place(self._first)))[:_SHORT]}"

    @property
    def heading(self) -> str:
        """Gallery and input."""
        first = self._first
        return f"{first.gallery} · {first.input}"

    @property
    def subtitle(self) -> str:
        """Data set, size, and what names its shapes."""
        first = self._first
        return (
            f"{first.data_title}: {first.n_shapes} shapes, {first.n_classes} classes; "
            f"digest of labels and inputs {first.gallery_digest[:_SHORT]}"
        )

    @property
    def chance(self) -> Mapping[str, float]:
        """Chance level by measure."""
        return self._first.chance

    def _of(self, status: str) -> list[BoardRow]:
        found = [row for row in self.rows if row.found.status == status]
        return sorted(found, key=lambda row: (-row.found.scores["DCG"], row.method, row.anchor))

    @property
    def verified(self) -> list[BoardRow]:
        """Rows that were verified, the best first."""
        return self._of("verified")

    @property
    def claimed(self) -> list[BoardRow]:
        """The others, the best first."""
        return self._of("claimed")


def write_leaderboard(
    bundles: Path, folder: Folder, request: Request, say: Callable[[str], None] = lambda line: None
) -> list[Bundle]:
    """Verify the bundles of a folder, write the page of them, and return what was found.

    What was found of a bundle is kept beside the page by the digest of the bundle, and taken again as long as neither
    the bundle nor this code nor what it is compared with is another one.

    Parameters
    ----------
    bundles
        Folder of zip files.
    folder
        Where the page goes.
    request
        How they are verified; its path is of no account.
    say
        Told what is being done.

    Raises
    ------
    ConfigurationError
        If there is no bundle, or the folder holds something else.
    """
    files = sorted(path for path in bundles.rglob("*.zip") if path.is_file()) if bundles.is_dir() else []
    if not files:
        raise ConfigurationError(f"{bundles} contains no bundle", "name a folder of files that 'submit' wrote")
    folder.claim(["index.html", "parts", "outcomes"])
    how = digest([text_of("benchmark/bundles"), request.n_again, *_known_as(request)])
    found: list[Bundle] = []
    for path in files:
        name = path.relative_to(bundles).as_posix()
        try:
            outcome = _kept(folder, path, how, with_run=request.run)
            if outcome is None:
                say(f"verifying {name}")
                outcome = verify(replace(request, path=path), say)
        except (OSError, BenchmarkError) as error:
            say(f"skipped {name}: {error}")
            continue
        folder.write(
            outcome_file(outcome.digest), json.dumps({"how": how, "outcome": outcome.to_plain()}, sort_keys=True)
        )
        if any(each.outcome.digest == outcome.digest for each in found):
            say(f"skipped {name}: another file is the same")
            continue
        found.append(Bundle(name, outcome))
    folder.write("index.html", page(found))
    assets = resources.files("benchmark.report.html").joinpath("assets")
    for asset in ("report.css", "report.js"):
        folder.write(f"parts/assets/{asset}", assets.joinpath(asset).read_text(encoding="utf-8"))
    folder.finish()
    return found


def page(bundles: Sequence[Bundle]) -> str:
    """Return the page."""
    shown = [each for each in bundles if each.outcome.status in ("verified", "claimed")]
    boards: dict[tuple[str, ...], list[BoardRow]] = {}
    for each in shown:
        for row in each.outcome.rows:
            boards.setdefault(_place(row), []).append(BoardRow(each, row))
    return _ENVIRONMENT.get_template("leaderboard.html").render(
        tables=[],
        pages=None,
        data={},
        printed=PRINTED,
        boards=[Board(tuple(boards[place])) for place in sorted(boards)],
        bundles=shown,
        refused=list(_refused(bundles)),
    )


def outcome_file(made_of: str) -> str:
    """Return where the outcome of a bundle is kept beside the page."""
    return f"outcomes/{made_of}.json"


def _place(row: RowOutcome) -> tuple[str, ...]:
    """Return gallery, input and the very shapes, which rows that can be compared share."""
    return row.gallery, row.input, row.gallery_digest


def _refused(bundles: Iterable[Bundle]) -> Iterable[tuple[str, ...]]:
    for each in bundles:
        if each.outcome.status in ("verified", "claimed"):
            continue
        faults = [("", fault) for fault in each.outcome.faults]
        faults += [(f"{row.gallery} {row.input}", fault) for row in each.outcome.rows for fault in row.faults]
        for record, fault in faults:
            yield each.file, each.outcome.method, record, fault.status, fault.name, f"{fault.problem}; {fault.hint}"


def _known_as(request: Request) -> list[str]:
    known = request.known
    return [str(known.results), str(known.data_root), *(f"{name} {path}" for name, path in known.folders.items())]


def _kept(folder: Folder, path: Path, how: str, *, with_run: bool) -> Outcome | None:
    """Return what was found of a bundle before; None where that is not known, or was no end."""
    made_of = digest_of_file(path)
    try:
        content = json.loads((folder.root / outcome_file(made_of)).read_text(encoding="utf-8"))
        outcome = Outcome.from_plain(content["outcome"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    is_end = outcome.status != "claimed" and (outcome.with_run or not with_run)
    return outcome if content["how"] == how and outcome.digest == made_of and is_end else None
