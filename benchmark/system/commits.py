"""The commit of the code that runs, where the suite lies in a git repository."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

from benchmark.system.fingerprints import FIRST_PARTY

#: Folder that holds the packages of the suite.
ROOT = Path(__file__).parents[2]


def git(root: Path, *words: str) -> str | None:
    """Return what git says in a repository; None where it fails, or there is no git."""
    try:
        done = subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True, check=False)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@cache
def commit() -> str:
    """Return the first ten digits of the commit, with ``+`` where files differ from it; "" outside of a repository."""
    if not (ROOT / ".git").exists():  # an installed suite may lie inside of somebody else's repository
        return ""
    found = git(ROOT, "rev-parse", "--short=10", "HEAD")
    if not found:
        return ""
    return f"{found}+" if git(ROOT, "status", "--porcelain", "--untracked-files=no", "--", *FIRST_PARTY) else found
