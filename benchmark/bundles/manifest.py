"""Contents of a bundle: what it says of itself, and the names of its files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, get_args

from benchmark.errors import BenchmarkError
from benchmark.text import clean

#: First entry of every manifest.
FORMAT = "canonical-forms bundle 1"

#: The manifest among the files of a bundle.
MANIFEST = "bundle.json"

#: Names that a bundle may hold; whatever else is in it, it is refused as a whole.
NAMES = re.compile(
    r"bundle\.json|records/[0-9a-f]{32}\.json|(?:arrays|distances)/[0-9a-f]{32}\.npz"
    r"|plugin/(?:[A-Za-z_][\w-]*/)*[A-Za-z_][\w.-]*\.py",
    re.ASCII,
)

#: Characters of the longest name, or other text, of a bundle.
LONGEST = 500

#: The same of what names the mesh of a shape, which may be all parameters of a generator.
_LONGEST_SOURCE = 10_000

Holds = Literal["forms", "signatures", "descriptors"]

Status = Literal["unreadable", "false", "claimed", "verified"]


class BundleError(BenchmarkError):
    """A fault of a bundle: its name, by which it is listed, what is wrong, and what to do.

    Parameters
    ----------
    name
        Words joined by hyphens: ``"path-outside"``.
    problem, hint
        As of every error.
    status
        What the whole bundle is by it.
    """

    def __init__(self, name: str, problem: str, hint: str, status: Status = "unreadable") -> None:
        super().__init__(problem, hint)
        self.name, self.status = name, status


@dataclass(frozen=True)
class Plugin:
    """The plug-in of a bundle.

    Parameters
    ----------
    file
        The plug-in among the files of the bundle; the modules that it imports lie beside it.
    attribute
        The method in it.
    digests
        SHA-256 of each of its files.
    """

    file: str
    attribute: str
    digests: Mapping[str, str]


@dataclass(frozen=True)
class Entry:
    """A record of a bundle, and what it was made from.

    Parameters
    ----------
    key
        Of the record; its files are called by it.
    holds
        Kind of the arrays from which the scores can be computed again.
    withheld
        Why forms are not in the bundle; "" where they are, or there are none.
    inputs
        For each shape of the gallery what names its mesh, and the digest of the prepared shape, "" for one without
        result.
    """

    key: str
    holds: Holds
    withheld: str
    inputs: Mapping[str, tuple[str, str]]

    @property
    def record(self) -> str:
        """Name of the record among the files."""
        return f"records/{self.key}.json"

    @property
    def arrays(self) -> str:
        """Name of the arrays among the files."""
        return f"arrays/{self.key}.npz"

    @property
    def distances(self) -> str:
        """Name of the distances among the files."""
        return f"distances/{self.key}.npz"


@dataclass(frozen=True)
class Manifest:
    """A bundle as it describes itself.

    Parameters
    ----------
    method, base_name, title
        The method with its parameters, without them, and in tables.
    author, licence
        Who made it, and under which licence it is passed on.
    versions
        Of the suite, Python and the packages that compute.
    plugin
        Its source; None for a method of the suite or of an installed package.
    entries
        Its records.
    """

    method: str
    base_name: str
    title: str
    author: str
    licence: str
    versions: Mapping[str, str]
    plugin: Plugin | None
    entries: tuple[Entry, ...]
    format: str = field(default=FORMAT)

    def to_plain(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return asdict(self)


def manifest_of(content: Any) -> Manifest:
    """Read what JSON holds; raises :class:`BundleError` if it is no manifest."""
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise BundleError("no-bundle", f"{MANIFEST} does not describe a bundle", "make it with 'submit'")
    try:
        texts = ("method", "base_name", "title", "author", "licence")
        told = {name: _text(content[name]) for name in texts}
        plugin = None if content["plugin"] is None else _plugin(content["plugin"])
        entries = tuple(map(_entry, content["entries"]))
        return Manifest(**told, versions=_texts(content["versions"]), plugin=plugin, entries=entries)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        said = f"{MANIFEST} lacks a part, or holds something else in it ({clean(error)[:80]})"
        raise BundleError("no-bundle", said, "make it with 'submit', and edit nothing") from error


def _plugin(content: Mapping[str, Any]) -> Plugin:
    found = Plugin(_text(content["file"]), _text(content["attribute"]), _texts(content["digests"]))
    if not all(name.startswith("plugin/") for name in found.digests) or not found.attribute.isidentifier():
        raise ValueError("plugin")
    if found.file not in found.digests:
        raise ValueError("plugin")
    return found


def _entry(content: Mapping[str, Any]) -> Entry:
    told = content["inputs"].items()
    inputs = {_text(name): (_text(source, _LONGEST_SOURCE), _text(digest)) for name, (source, digest) in told}
    if not re.fullmatch(r"[0-9a-f]{32}", content["key"]) or content["holds"] not in get_args(Holds):
        raise ValueError("key or holds")
    return Entry(content["key"], content["holds"], _text(content["withheld"]), inputs)


def _texts(content: Mapping[str, Any]) -> dict[str, str]:
    return {_text(name): _text(value) for name, value in content.items()}


def _text(value: Any, longest: int = LONGEST) -> str:
    if not isinstance(value, str) or len(value) > longest:
        raise ValueError(f"{value!s:.40} is no short text")
    return value
