"""What a plugin reads: a file of the user must be in its code, or declared.

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
from typing import Any, NamedTuple

from benchmark.code_digest import FIRST_PARTY, ROOT, sources_of
from benchmark.errors import ConfigurationError
from benchmark.places import no_places_of_the_user

#: Folders of Python, of the suite and of the system: files in them determine no result.
_EXEMPT = (
    sys.prefix,
    sys.base_prefix,
    *sysconfig.get_paths().values(),
    *(str(ROOT / name) for name in FIRST_PARTY),
    "/usr",
    "/lib",
    "/lib64",
    "/etc",
    "/proc",
    "/sys",
)

#: Endings of files with compiled kernels, which go when the plugin is loaded.
_KERNELS = (".nbi", ".nbc")

#: Endings of folders that say what is installed, in which libraries search for entry points.
_METADATA = (".dist-info", ".egg-info")

#: Names of folders with installed packages.
_PACKAGES = ("site-packages", "dist-packages")

_NANOSECONDS_PER_SECOND = 1e9

#: Seconds by which the clock of a file system may be late.
_LATE = 0.02

#: When this process began.
_STARTED = time.time() - _LATE

#: Takes each file that is opened while the code of a plugin runs; None between plugins.
_take: Callable[[Path, _Opened], None] | None = None

#: The first file that each plugin should have declared.
_undeclared: dict[Path, Path] = {}

#: Events of Python by which a process runs a program in the working folder.
_RUNS_PROGRAM = ("os.posix_spawn", "os.exec", "os.system")

#: A word within the text of a command.
_WORD = re.compile(r"[^\s'\"`<>|&;=(),:]+")


class _Opened(NamedTuple):
    """How a file was opened.

    Parameters
    ----------
    changed_ns
        When it changed last, in nanoseconds.
    is_program
        Whether it is a program or a library, or the word of a command that may name one.
    """

    changed_ns: int
    is_program: bool


class UndeclaredFile(ConfigurationError):
    """A plugin reads a file that is neither in its code nor declared."""


@cache
def watch_this_process() -> None:
    """Let this process see what plugins read.

    It cannot be undone, so that only workers and the command line call it.
    """
    sys.addaudithook(_hook)


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    """Note which files Python opens, imports or runs, from an audit event.

    Parameters
    ----------
    event, arguments
        Name and arguments of the event; see "Audit events table" in the documentation of Python.
    """
    if _take is None:  # nothing is watched now
        return
    if event == "open":
        path, _, flags = arguments
        opens_for_writing = flags & os.O_ACCMODE == os.O_WRONLY
        is_written_only = opens_for_writing or flags & os.O_TRUNC
        if not is_written_only:
            _note(path)
    elif event == "import":
        _note(arguments[1])  # file of a compiled extension; None for a source, which is opened
    elif event == "sqlite3.connect":
        _note(arguments[0])
    elif event == "ctypes.dlopen":
        _note(arguments[0], is_program=True)
    elif event == "subprocess.Popen":
        program, words, folder, _ = arguments
        _note_command([program, *words], folder or "")
    elif event in _RUNS_PROGRAM:
        program = arguments[0]
        words = arguments[1] if len(arguments) > 1 else ()
        _note_command([program, *words])


def _note_command(words: Iterable[Any], folder: Any = "") -> None:
    """Note the files that words of a command, or parts of them, may name, from some folder."""
    for word in words:
        for name in (word, *_WORD.findall(os.fsdecode(word))):
            _note(name, folder, is_program=True)


def _note(path: Any, folder: Any = "", *, is_program: bool = False) -> None:
    """Note a regular file that is opened.

    Parameters
    ----------
    path, folder
        Its path, as it was given, and the folder from which it counts.
    is_program
        Whether it is a program or a library, or the word of a command that may name one.
    """
    with suppress(OSError, ValueError, TypeError):
        file = os.path.realpath(Path(os.fsdecode(folder), os.fsdecode(path)))
        if file.endswith(".pyc"):
            with suppress(ValueError):
                file = os.path.realpath(source_from_cache(file))
        status = Path(file).stat()
        if _take is not None and stat.S_ISREG(status.st_mode):
            _take(Path(file), _Opened(status.st_ctime_ns, is_program))


@contextmanager
def watching(
    target: str, allowed: Iterable[Path] = (), *, is_imported: bool = True
) -> Iterator[list[Path]]:
    """Watch which files the code of a plugin reads in a ``with`` block.

    Parameters
    ----------
    target
        The plugin file.
    allowed
        Files and folders that the code may read besides its own sources.
    is_imported
        Whether the plugin was imported before. Its sources are then those that are found now, as
        keys hold them. The import itself may add folders to the path of modules, so that its
        sources are those that are found at the end of the block.

    Yields
    ------
    list of Path
        The allowed files and folders; the block may add to it.

    Raises
    ------
    UndeclaredFile
        At the end of the block, if the code has opened, imported or run any other file that was
        there before, in this block or in an earlier one; at once in a process that it forks.
    """
    global _take
    declared = list(allowed)
    if _take is not None:  # within another block, whose plugin alone is watched
        yield declared
        return
    watch = _Watch(target, declared, sources_of(target) if is_imported else None)
    # A process that the code spawns would not be watched, so spawning is refused meanwhile.
    get_preparation_data = spawn.get_preparation_data
    spawn.get_preparation_data = _refuse_spawn
    _take = watch.take
    try:
        with no_places_of_the_user():
            yield declared
    finally:
        _take = None
        spawn.get_preparation_data = get_preparation_data
        watch.end()
    watch.check()


class _Watch:
    """What a plugin file opens while its code runs.

    Parameters
    ----------
    target
        The plugin file.
    declared
        Files and folders that it may read, which may grow meanwhile.
    sources
        Its source files; None for those that are found when a file is looked at.
    """

    def __init__(self, target: str, declared: list[Path], sources: list[Path] | None) -> None:
        self._target = target
        self._declared = declared
        self._sources = sources
        self._plugin = Path(target.rpartition(":")[0] or target)
        self._started = time.time() - _LATE
        self._process = os.getpid()
        self._opened: dict[Path, _Opened] = {}

    def take(self, file: Path, opened: _Opened) -> None:
        """Note a file; in a forked process, whose notes are lost with it, check it at once."""
        global _take
        self._opened.setdefault(file, opened)
        if os.getpid() != self._process:
            _take = None  # while files of the code are read
            if self._is_undeclared(file, opened):
                raise _undeclared_error(self._plugin, file)
            _take = self.take

    def end(self) -> None:
        """Note the first file that should have been declared."""
        for file, opened in self._opened.items():
            if self._is_undeclared(file, opened):
                _undeclared.setdefault(self._plugin, file)

    def check(self) -> None:
        """Raise ``UndeclaredFile`` if the plugin has ever read an undeclared file."""
        if self._plugin in _undeclared:
            raise _undeclared_error(self._plugin, _undeclared[self._plugin])

    def _is_undeclared(self, file: Path, opened: _Opened) -> bool:
        """Return whether the plugin should have declared a file that it has read.

        Parameters
        ----------
        file
            The file.
        opened
            How it was opened.
        """
        if not _is_of_user(file, self._plugin.parent, self._declared, is_program=opened.is_program):
            return False  # a declared file, or one of the system or of a package
        # A temporary file may have been written in an earlier step of this process.
        is_temporary = _lies_in(file, [tempfile.gettempdir()])
        since = _STARTED if is_temporary else self._started
        changed = opened.changed_ns / _NANOSECONDS_PER_SECOND
        # The upper bound leaves out files from the future, as clocks may be set back.
        was_written_by_plugin = since <= changed <= time.time() + _LATE
        if was_written_by_plugin:
            return False
        sources = sources_of(self._target) if self._sources is None else self._sources
        return file not in {source.resolve() for source in sources}


def _refuse_spawn(name: str) -> dict[str, Any]:
    """Refuse processes that nothing watches, and that cannot import a plugin file."""
    raise ConfigurationError(
        "it starts processes by 'spawn'", "use multiprocessing.get_context('fork')"
    )


def _undeclared_error(plugin: Path, file: Path) -> UndeclaredFile:
    """Return the error for a file that a plugin should have declared."""
    name = os.path.relpath(file, plugin.parent.resolve())
    verb = "reads"
    hint = f"declare it in info: files=({name!r},)"
    if file.suffix == ".py":
        verb = "imports"
        hint = (
            "write 'import NAME' or 'from NAME import ...', with the name as it is, and add "
            f"folders to sys.path when the plugin is imported, or {hint}"
        )
    return UndeclaredFile(f"{plugin} {verb} {file} in a way that its code does not show", hint)


def _is_of_user(file: Path, folder: Path, declared: Iterable[Path], *, is_program: bool) -> bool:
    """Return whether results may depend on a file that a plugin has read.

    Parameters
    ----------
    file
        The file.
    folder
        Folder of the plugin.
    declared
        Files and folders that the plugin may read.
    is_program
        Whether it is a program; of these, only those near the plugin count.
    """
    if file.parent.suffix in _METADATA or file.suffix in _KERNELS:
        return False
    exempt = _exempt_places(file, folder.resolve())
    if _lies_in(file, [*exempt, *declared, *_package_folders(tuple(sys.path))]):
        return False
    if not is_program:
        return True
    temporary = Path(tempfile.gettempdir()).resolve()
    near = [path for path in (folder.resolve(), Path.cwd()) if path not in (Path("/"), temporary)]
    return _lies_in(file, near)


def _exempt_places(file: Path, folder: Path) -> list[str]:
    """Return the folders of Python, of the suite and of the system that exempt a file.

    A plugin may lie in one of them, such as ``/usr/src``. Of the files beside it, only those in a
    folder within its own are exempt, such as an environment of Python.
    """
    if not file.is_relative_to(folder):
        return list(_EXEMPT)
    return [place for place in _EXEMPT if Path(os.path.realpath(place)).is_relative_to(folder)]


def _lies_in(file: Path, folders: Iterable[Path | str]) -> bool:
    """Return whether a file is one of some files, or lies in one of some folders."""
    places = (os.path.realpath(Path(folder).expanduser()) for folder in folders)
    return any(map(file.is_relative_to, places))


@cache
def _package_folders(places: tuple[str, ...]) -> list[Path]:
    """Return the folders on the path that hold installed packages, or lie in one."""
    folders = [Path(place) for place in places if place]
    return [
        folder
        for folder in folders
        if not {*folder.parts}.isdisjoint(_PACKAGES) or any(folder.glob("*.dist-info"))
    ]
