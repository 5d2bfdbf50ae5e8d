"""Blocks of code on pages."""

from __future__ import annotations

import re


def blocks_of(text: str, kind: str) -> list[str]:
    """Return the contents of the fenced blocks of a page of this kind, such as ``sh``; there must
    be one, so that a test does not look for nothing when a page writes its blocks in another way.
    """
    found = re.findall(rf"^```{kind}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert found, f"no block of the kind {kind}"
    return found


def commands_of(text: str) -> list[str]:
    """Return the commands of a page, each on one line, also where the page breaks it."""
    return [
        line
        for block in blocks_of(text, "sh")
        for line in block.replace("\\\n", " ").splitlines()
        if line and not line.startswith("#")
    ]
