"""Describe the environment of a run: commit, package versions, system, and linear algebra library."""

from __future__ import annotations

import json
import platform
import subprocess
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmark.source_code import FIRST_PARTY, ROOT
from benchmark.text import brief

#: Packages that affect results.
PACKAGES = ("numpy", "scipy", "numba", "libigl", "pymeshlab", "potpourri3d", "torch", "anny")


@cache
def environment() -> dict[str, str]:
    """Return package versions and the machine; packages that are not installed are omitted."""
    versions = {"python": platform.python_version(), "machine": platform.machine(), "system": platform.system()}
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except ImportError:
            continue
    return versions | _linear_algebra()


@cache
def environment_text() -> str:
    """Return :func:`environment` as one line, which is stored with every artefact."""
    return json.dumps(environment(), sort_keys=True)


def changed_packages(environments: Iterable[Mapping[str, Any]]) -> str:
    """Describe the packages whose local versions differ from those in the environments; "" if none do."""
    current, texts = environment(), {str(entry.get("environment", "{}")) for entry in environments}
    changes: dict[str, None] = {}
    for earlier in map(versions_in, sorted(texts)):
        pairs = ((name, _release(earlier.get(name)), _release(current.get(name))) for name in PACKAGES)
        changes |= {f"{name} {then} -> {now}": None for name, then, now in pairs if then and now and then != now}
    return ", ".join(changes)


@cache
def versions_in(text: str) -> dict[str, str]:
    """Return the package versions in an environment; empty if it cannot be read."""
    try:
        versions = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return versions if isinstance(versions, dict) else {}


def _release(version: Any) -> str:
    """Return a version without its build tag, such as ``+cpu``."""
    return str(version or "").partition("+")[0]


def in_words(environment: Any) -> str:
    """Return the environment of a record or an artefact as a short line, even if it is malformed."""
    try:
        facts = json.loads(environment) if isinstance(environment, str) else environment
    except (ValueError, RecursionError):
        facts = environment
    return ", ".join(f"{name} {value}" for name, value in facts.items()) if isinstance(facts, dict) else brief(facts)


def _linear_algebra() -> dict[str, str]:
    """Return the BLAS library and kernels of NumPy; their last bits differ between processors."""
    from threadpoolctl import threadpool_info

    loaded = (part for part in threadpool_info() if part.get("user_api") == "blas")
    kinds = {f"{part['internal_api']} {part.get('version')} {part.get('architecture', '')}".strip() for part in loaded}
    return {"blas": ", ".join(sorted(kinds))} if kinds else {}


def git(root: Path, *words: str) -> str | None:
    """Return the output of git in a repository; None if it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(root), *words], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@cache
def commit() -> str:
    """Return the first ten digits of the commit, with ``+`` if files were changed; "" outside a repository."""
    if not (ROOT / ".git").exists():  # an installed suite may be inside another repository
        return ""
    digest = git(ROOT, "rev-parse", "--short=10", "HEAD")
    if not digest:
        return ""
    return f"{digest}+" if git(ROOT, "status", "--porcelain", "--untracked-files=no", "--", *FIRST_PARTY) else digest
