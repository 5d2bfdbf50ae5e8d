"""Digest of what a job ranks: the names, classes and contents of its shapes, in their order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmark.api.contracts import Input
from benchmark.code_digest import digest


def digest_of_shapes(
    shapes: Iterable[tuple[str, str, str]], settings: Sequence[object] = ()
) -> str:
    """Return the digest of a gallery.

    Parameters
    ----------
    shapes
        Name, class and content of each shape, in the order of the gallery. The content is the key
        of its mesh, such as the SHA-256 of its file.
    settings
        What else its folder sets, such as the frame of its camera; empty for a set of the suite.
    """
    return digest([*shapes, *settings])


def digest_of_both(
    queries: str, gallery: str, gallery_input: Input, *, keeps_same_names: bool, cameras: str = ""
) -> str:
    """Return the digest of queries that rank another gallery.

    Parameters
    ----------
    queries, gallery
        Digests of the shapes of each.
    gallery_input
        What is ranked of the gallery.
    keeps_same_names
        Whether a query leaves out no shape of its own name.
    cameras
        The change of the data set by which its shapes are seen from around; "" for none.
    """
    both: list[object] = [queries, gallery, gallery_input, keeps_same_names]
    if cameras:
        both.append(cameras)
    return digest(both)
