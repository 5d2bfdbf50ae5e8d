"""Errors in depth images; each excludes one shape."""

from __future__ import annotations

from benchmark.errors import ShapeError


class DepthError(ShapeError):
    """A problem with a depth image or one of its companion files."""


class UnreadableDepth(DepthError):
    """A depth image is missing, damaged, or in a format without depth."""


class InvalidDepth(DepthError):
    """A depth image is readable, but its values are not plausible depths of a scene in metres."""


class InvalidIntrinsics(DepthError):
    """Intrinsics are missing, unreadable, singular, or belong to another image."""


class InvalidMask(DepthError):
    """A mask is unreadable, empty, or differs in size from its image."""


class NoObject(DepthError):
    """A depth image shows no object, or one that does not fit the frame."""
