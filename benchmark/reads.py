"""What a plugin reads: a file of the user that it opens, imports or runs must be in its code or declared.

An audit hook sees what Python opens. It sees no environment variable, and no file that compiled
code opens, so that ``files`` remains the contract.
"""

from __future__ import annotations

import os
import re
import stat
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import source_from_cache
from multiprocessing import spawn
from pathlib import Path
from typing import Any

from benchmark.code_digest import FIRST_PARTY, ROOT, sources_of
from benchmark.errors import ConfigurationError
from benchmark.places import no_places_of_the_user

#: Folders of Python and of the system, and models of the suite: no result depends on others.
_EXEMPT = (
    *(
        sys.prefix,
        sys.base_prefix,
        *sysconfig.get_paths().values(),
        *(str(ROOT / name) for name in FIRST_PARTY),
    ),
    *("/usr", "/lib", "/lib64", "/etc", "/proc", "/sys"),
)

#: Seconds by which the clock of a file system may be late.
_LATE = 0.02

#: When this process began.
_STARTED = time.time() - _LATE

#: Takes a file that the plugin whose code runs opens; for each plugin, the first one that it should
#: have declared.
_take: Callable[[Path, int, bool], None] | None = None
_undeclared: dict[Path, Path] = {}

#: A word within the text of a command.
_WORD = re.compile(r"[^\s'\"`<>|&;=(),:]+")


class UndeclaredFile(ConfigurationError):
    """A plugin reads a file that is neither in its code nor declared."""


@cache
def watch_this_process() -> None:
    """Let this process see what plugins read. It cannot be undone: for workers and the command line alone."""
    sys.addaudithook(_hook)


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _take is None:
        return
    if event == "open":
        path, _, flags = arguments
        if flags & os.O_ACCMODE != os.O_WRONLY and not flags & os.O_TRUNC:
            _note(path)
    elif event in ("import", "sqlite3.connect"):  # of a compiled extension, or None
        _note(arguments[event == "import"])
    elif event == "ctypes.dlopen":
        _note(arguments[0], is_program=True)
    elif event in ("subprocess.Popen", "os.posix_spawn", "os.exec", "os.system"):
        folder = arguments[2] if event == "subprocess.Popen" else None
        for word in (arguments[0], *(arguments[1] if arguments[1:] else ())):
            for name in (word, *_WORD.findall(os.fsdecode(word))):
                _note(name, folder or "", is_program=True)


def _note(path: Any, folder: Any = "", *, is_program: bool = False) -> None:
    """Note when a regular file changed last, and whether it is a program or a library, or a word that may name one."""
    with suppress(OSError, ValueError, TypeError):
        file = os.path.realpath(Path(os.fsdecode(folder), os.fsdecode(path)))
        if file.endswith(".pyc"):
            with suppress(ValueError):
                file = os.path.realpath(source_from_cache(file))
        status = Path(file).stat()
        if _take is not None and stat.S_ISREG(status.st_mode):
            _take(Path(file), status.st_ctime_ns, is_program)


@contextmanager
def watching(target: str, allowed: Iterable[Path] = ()) -> Iterator[list[Path]]:
    """Watch what a plugin file reads while its code runs, beside its sources and the files of the list that it gets.

    Parameters
    ----------
    target
        The plugin file.
    allowed
        Folders and files that it may read.

    Raises
    ------
    UndeclaredFile
        If it opens, imports or runs another file that was there before, now or earlier in this
        process; in a process that it forked, at once.
    """
    global _take
    declared, begun, process = [*allowed], time.time() - _LATE, os.getpid()
    if _take is not None:
        yield declared
        return
    plugin = Path(target.rpartition(":")[0] or target)
    opened: dict[Path, tuple[int, bool]] = {}

    def is_undeclared(file: Path, changed: int, is_program: bool) -> bool:
        is_temporary = _lies_in(
            file, [tempfile.gettempdir()]
        )  # which code may make in one step for the next
        since = _STARTED if is_temporary else begun
        is_made_meanwhile = since <= changed / 1e9 <= time.time() + _LATE  # clocks may be set back
        is_of_user = _is_of_user(file, plugin.parent, declared, is_program=is_program)
        return (
            is_of_user
            and not is_made_meanwhile
            and file not in map(Path.resolve, sources_of(target))
        )

    def take(file: Path, changed: int, is_program: bool) -> None:
        global _take
        opened.setdefault(file, (changed, is_program))
        if os.getpid() != process:  # whose notes are lost with it
            _take = None  # while files of the code are read
            if is_undeclared(file, changed, is_program):
                raise _error(plugin, file)
            _take = take

    describing, spawn.get_preparation_data = spawn.get_preparation_data, _refuse_spawn
    _take = take
    try:
        with no_places_of_the_user():
            yield declared
    finally:
        _take, spawn.get_preparation_data = None, describing
        for file, facts in opened.items():
            if is_undeclared(file, *facts):
                _undeclared.setdefault(plugin, file)
    if found := _undeclared.get(plugin):
        raise _error(plugin, found)


def _refuse_spawn(name: str) -> dict[str, Any]:
    """Refuse processes that nothing watches, and that cannot import a plugin file."""
    raise ConfigurationError(
        "it starts processes by 'spawn'", "use multiprocessing.get_context('fork')"
    )


def _error(plugin: Path, found: Path) -> UndeclaredFile:
    does, hint = (
        "reads",
        f"declare it in info: files=({os.path.relpath(found, plugin.parent.resolve())!r},)",
    )
    if found.suffix == ".py":
        does, hint = (
            "imports",
            f"write 'import NAME' or 'from NAME import ...', with the name as it is, or {hint}",
        )
    return UndeclaredFile(f"{plugin} {does} {found} in a way that its code does not show", hint)


def _is_of_user(file: Path, folder: Path, declared: Iterable[Path], *, is_program: bool) -> bool:
    """Return whether results may depend on a file that a plugin in a folder has read; of programs, those near it."""
    exempt: list[Path | str] = [*_EXEMPT, *declared, *_package_folders(tuple(sys.path))]
    is_metadata = file.parent.suffix in (
        ".dist-info",
        ".egg-info",
    )  # which libraries search for entry points
    if (
        is_metadata or file.suffix in (".nbi", ".nbc") or _lies_in(file, exempt)
    ):  # kernels go when it is loaded
        return False
    temporary = Path(tempfile.gettempdir()).resolve()
    near = [path for path in (folder.resolve(), Path.cwd()) if path not in (Path("/"), temporary)]
    return _lies_in(file, near) or not is_program


def _lies_in(file: Path, folders: Iterable[Path | str]) -> bool:
    return any(
        file.is_relative_to(os.path.realpath(Path(folder).expanduser())) for folder in folders
    )


@cache
def _package_folders(places: tuple[str, ...]) -> list[Path]:
    """Return the folders on the path that hold installed packages, or lie in one."""
    found = [Path(place) for place in places if place]
    return [
        of
        for of in found
        if {"site-packages", "dist-packages"} & {*of.parts} or any(of.glob("*.dist-info"))
    ]
