"""What the data of a record are called: generated stand-in, known copy, or files that bear the names of a set.

A record of an official set holds a digest of the names, classes and contents of its shapes. It
ranks a known copy if the files of that copy have the same digest, so that no name and no count
makes other meshes an official set. The title is looked up whenever it is printed, and no record
holds it.
"""

from __future__ import annotations

import re

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.changes import CHANGES, split_changes, with_change
from benchmark.datasets.copies import KnownCopy
from benchmark.datasets.official import SETS, OfficialSet
from benchmark.datasets.sizes import key_with_area
from benchmark.errors import ConfigurationError, UnreadableMesh
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.gallery_digest import digest_of_both, digest_of_shapes
from benchmark.pipeline.records import RankedShapes, Record
from benchmark.text import brief


def data_title(record: Record) -> str:
    """Return the title of the data of a record; it always says if they are a stand-in, or unverified."""
    data = record.data
    if data.stand_in_for:
        name = data.name.partition("[draw=")[0]
        replaced = SETS.get(data.stand_in_for)
        return (
            f"generated stand-in '{name}', not {replaced.title if replaced else data.stand_in_for}"
        )
    official = official_set(record)
    if official is None:
        return brief(data.title)
    copy = known_copy(record)
    name = copy.title if copy else f"files named like {official.title}, unverified"
    _, is_official, change = data.title.partition(official.title)
    return brief(name + change if is_official else name)


def short_data_title(record: Record) -> str:
    """Return a short title of the data of a record, as headings and menus show it."""
    title = data_title(record) if official_set(record) else record.data.title
    title = re.sub(r", draw \d+", "", title)
    title = re.sub(r" \((stand-in|generated)[^)]*\)", " (generated)", title)
    return re.sub(
        r"view angle: largest angle in degrees (\d+)$", r"cameras turned up to \1°", title
    )


def official_set(record: RankedShapes) -> OfficialSet | None:
    """Return the official set whose names the data of a record bear; None for generated ones and folders."""
    if record.data.path or record.data.stand_in_for:
        return None
    return SETS.get(record.data.name.partition("[")[0])


def known_copy(record: Record) -> KnownCopy | None:
    """Return the known copy of an official set that a record ranks, queries and gallery alike."""
    official = official_set(record)
    if official is None:
        return None
    return next((copy for copy in official.copies if _ranks(record, copy)), None)


def _ranks(record: Record, copy: KnownCopy) -> bool:
    """Return whether the digest of a record is that of the files of a copy."""
    queries, gallery = _digest(record, copy), record.gallery_of_queries
    if gallery is None:
        return record.gallery_digest == queries
    if gallery.gallery_digest != _digest(gallery, copy):
        return False
    views = gallery.views
    around = ("", f"[cameras={views}]", f"[cameras-and-own={views - 1}]")
    keeps = record.keeps_same_names
    every = {
        digest_of_both(
            queries,
            gallery.gallery_digest,
            gallery.input,
            keeps_same_names=keeps,
            cameras=cameras,
        )
        for cameras in around
    }
    return record.gallery_digest in every


def _digest(ranked: RankedShapes, copy: KnownCopy) -> str:
    """Return the digest that ranked shapes have if they are those of a copy, with the changes of their set."""
    try:
        _, changes = split_changes(ranked.data.name)
    except ConfigurationError:  # a change that this version does not know
        return ""
    shapes = ShapeSet(
        name="copy",
        shapes=tuple(
            Entry(name, label, "")
            for name, label in zip(ranked.shapes, ranked.labels, strict=False)
        ),
        key=lambda entry: _key(entry.identifier, copy),
        load=_no_mesh,
    )
    for change, level in changes:
        if CHANGES[change].of_set is None:  # views of a shape have its key
            shapes = with_change(shapes, change, level)
    return digest_of_shapes(
        (entry.identifier, entry.subject, shapes.key(entry)) for entry in shapes.shapes
    )


def _key(identifier: str, copy: KnownCopy) -> str:
    """Return the key of the mesh of a shape, or of a view of it, in a copy; "" if it has none."""
    digest = copy.digests.get(identifier.partition("@")[0].lower(), "")
    return key_with_area(digest, copy.area)


def _no_mesh(entry: Entry) -> Mesh:
    raise UnreadableMesh(f"the mesh of {entry.identifier} is not here", "only its digest is known")
