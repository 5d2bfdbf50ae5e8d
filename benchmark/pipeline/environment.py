"""Where results come from: the commit, and versions of packages."""

from __future__ import annotations

import platform
import subprocess
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from benchmark.code_digest import FIRST_PARTY, ROOT

#: Packages that move results.
PACKAGES = ("numpy", "scipy", "scikit-learn", "numba", "libigl", "pymeshlab", "torch", "anny")


@cache
def packages() -> dict[str, str]:
    """Return the versions of Python and of the installed packages, and the machine."""
    versions = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": platform.system(),
    }
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


@cache
def commit() -> str:
    """Return the first ten digits of the commit; "" outside a repository.

    A ``+`` behind them says that code was changed.
    """
    digits = _git("rev-parse", "--short=10", "HEAD")
    return f"{digits}+" if digits and has_edits() else digits


def has_edits() -> bool:
    """Return whether files of the suite differ from the commit."""
    return bool(_git("status", "--porcelain", "--untracked-files=no", "--", *FIRST_PARTY))


def _git(*words: str) -> str:
    """Return the output of git in the suite's own repository; "" if there is none."""
    if not (ROOT / ".git").exists():  # an installed suite may lie inside of another repository
        return ""
    command = ["git", "--no-optional-locks", "-C", str(ROOT), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
