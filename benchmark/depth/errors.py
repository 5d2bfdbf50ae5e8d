"""Errors of depth images; each costs one shape."""

from __future__ import annotations

from benchmark.errors import ShapeError


class DepthError(ShapeError):
    """A problem of one depth image, or of a file that belongs to it."""


class UnreadableDepth(DepthError):
    """A depth image is missing, damaged, or of a kind that holds no depth."""


class InvalidDepth(DepthError):
    """A depth image was read, but its depths cannot be those of a scene in metres."""


class InvalidIntrinsics(DepthError):
    """Intrinsics are missing, unreadable, singular, or those of another image."""


class InvalidMask(DepthError):
    """A mask cannot be read, is empty, or has another size than its image."""


class NoObject(DepthError):
    """No object was found in a depth image, or it does not fit the frame."""
