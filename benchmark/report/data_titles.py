"""What the data of a record are called: a stand-in, a known copy, or files named like a set.

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
from benchmark.registry.names import base_name
from benchmark.text import brief


def data_title(record: Record) -> str:
    """Return what tables call the data of a record.

    The title says so if the data are generated ones that stand in for an official set, or files
    that have the names of an official set but not its content.

    Parameters
    ----------
    record
        A record, which holds digests of its data.
    """
    data = record.data
    if data.stand_in_for:
        name = data.name.replace("[draw=0]", "")
        replaced = data.stand_in_for
        if replaced in SETS:
            replaced = SETS[replaced].title
        return f"generated stand-in '{name}', not {replaced}"
    official = official_set(record)
    if official is None:
        return brief(data.title)
    copy = known_copy(record)
    title = copy.title if copy else f"files named like {official.title}, unverified"
    # In the title of the data, words behind that of the set say how it was changed, as by noise.
    _, is_titled, change = data.title.partition(official.title)
    if is_titled:
        title += change
    return brief(title)


def short_data_title(record: Record) -> str:
    """Return a short title of the data of a record, as headings and menus show it."""
    title = data_title(record) if official_set(record) else record.data.title
    title = re.sub(r", draw \d+", "", title)
    title = re.sub(r" \((stand-in|generated)[^)]*\)", " (generated)", title)
    return re.sub(
        r"view angle: largest angle in degrees (\d+)$", r"cameras turned up to \1°", title
    )


def official_set(record: RankedShapes) -> OfficialSet | None:
    """Return the official set whose names the data of a record bear.

    It is None for generated ones and folders.
    """
    if record.data.path or record.data.stand_in_for:
        return None
    return SETS.get(base_name(record.data.name))


def known_copy(record: Record) -> KnownCopy | None:
    """Return the known copy of an official set that a record ranks, queries and gallery alike."""
    official = official_set(record)
    if official is None:
        return None
    return next((copy for copy in official.copies if _ranks(record, copy)), None)


def _ranks(record: Record, copy: KnownCopy) -> bool:
    """Return whether a record was computed from the files of a known copy of an official data set.

    The digests of the files of the copy are known. From these, the digest of the gallery is
    computed that the record should have.

    Parameters
    ----------
    record
        A record of an official data set.
    copy
        One of the known copies of this set.
    """
    queries = _digest(record, copy)
    gallery = record.gallery_of_queries
    if gallery is None:
        return record.gallery_digest == queries
    if gallery.gallery_digest != _digest(gallery, copy):
        return False
    # The record does not say how its gallery was rendered: by one camera, by several around each
    # shape, or by these and the camera of the shape itself. Any of these may be meant.
    views = gallery.views
    for cameras in ("", f"[cameras={views}]", f"[cameras-and-own={views - 1}]"):
        expected = digest_of_both(
            queries,
            gallery.gallery_digest,
            gallery.input,
            keeps_same_names=record.keeps_same_names,
            cameras=cameras,
        )
        if record.gallery_digest == expected:
            return True
    return False


def _digest(ranked: RankedShapes, copy: KnownCopy) -> str:
    """Return the digest that these shapes would have if their files were those of a copy.

    Parameters
    ----------
    ranked
        Names, classes and data set of the shapes. The name of the set says how its meshes were
        changed, such as ``tosca[noise=2]``.
    copy
        Digests of the files of a copy of an official set.

    Returns
    -------
    str
        The digest; "" if the set was changed in a way that this version does not know.
    """
    try:
        _, changes = split_changes(ranked.data.name)
    except ConfigurationError:
        return ""
    named = zip(ranked.shapes, ranked.labels, strict=False)
    entries = [Entry(name, label, "") for name, label in named]
    shapes = ShapeSet(
        name="copy",
        shapes=tuple(entries),
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
    """Raise ``UnreadableMesh``: this set has keys of its shapes, and no meshes."""
    raise UnreadableMesh(f"the mesh of {entry.identifier} is not here", "only its digest is known")
