"""Keep what a step makes only if the files that its key names stayed those of the plan.

Files are looked at before and after each step, by inode, size and times. Contents are read where
these differ from the last look, and where a file changed so lately that the clock of its file
system may not tell two changes apart.
"""

from __future__ import annotations

import hashlib
import os
import time
from bdb import BdbQuit
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.code_digest import code_of, code_of_modules, digest, sources_of
from benchmark.errors import BenchmarkError
from benchmark.files import chunks_of, file_digest
from benchmark.kernel_cache import suite_sources
from benchmark.text import listed

#: Seconds between two changes of a file that some file systems do not tell apart.
_COARSEST_CLOCK = 2.0

_NANOSECONDS_PER_SECOND = 1e9


class CodeChanged(BenchmarkError):
    """Files of a job are not those of its plan; the process may hold others in memory."""

    def __init__(self, what: str) -> None:
        problem = f"{what} changed during the run, or is another one on this machine"
        super().__init__(problem, "run again")


class PlannedCode(NamedTuple):
    """What the files of a method or scorer held when the run was planned.

    Parameters
    ----------
    target, modules
        Its class, and the modules of the suite that use it.
    files
        Names of the files that it declares.
    parts
        Digests and versions by name; see :func:`benchmark.code_digest.code_of`.
    """

    target: str
    modules: tuple[str, ...]
    files: tuple[str, ...]
    parts: Mapping[str, str]


def plan_code(target: str, modules: Iterable[str], files: Iterable[str]) -> PlannedCode:
    """Return what the files of a method or scorer hold now."""
    code = PlannedCode(target, tuple(modules), tuple(files), {})
    return code._replace(parts=_current_parts(code))


def _current_parts(code: PlannedCode) -> dict[str, str]:
    """Return digests and versions of code as they are now."""
    return code_of(code.target, code.files) | code_of_modules(code.modules)


class PlannedFiles:
    """The files on which steps depend, which must be those of the plan before and after each step.

    Parameters
    ----------
    code
        What the plan saw.
    model, card
        Folder of the trained model, and the digest of its card when the run was planned.
    """

    def __init__(self, code: PlannedCode, model: Path | None = None, card: str = "") -> None:
        self._code = code
        self._model = model
        self._card = card
        #: The files as they were when all contents were those of the plan.
        self._confirmed: _Snapshot | None = None

    @contextmanager
    def unchanged(self) -> Iterator[None]:
        """Run a step.

        Raises
        ------
        CodeChanged
            If a file is not that of the plan before the step, or changes during it. An error of the
            step may then be that of a file that was half written, so that it counts no more.
        """
        before = self._confirm()
        try:
            yield
        except (KeyboardInterrupt, BdbQuit):
            raise
        except BaseException as error:
            self._check_since(before, error)
            raise
        self._check_since(before)

    def _confirm(self) -> _Snapshot:
        """Check that all files have the contents of the plan, and return their state.

        Contents are read only if sizes or times of files have changed since the last check.

        Raises
        ------
        CodeChanged
            If a file differs, is new or is missing, or changes during the check.
        """
        last = self._confirmed
        if last is not None and not last.changes() and not last.look_for_new_files():
            # Contents of files that were written long ago need no more comparisons: another change
            # would be seen by its time.
            last.forget_settled()
            return last
        snapshot = _Snapshot(self._files())
        self._check_contents()
        changed_meanwhile = snapshot.changes()
        if changed_meanwhile:
            raise CodeChanged(listed(changed_meanwhile))
        self._confirmed = snapshot
        return snapshot

    def _check_since(self, before: _Snapshot, error: BaseException | None = None) -> None:
        """Raise ``CodeChanged`` if a file changed since a snapshot, also if it was put back."""
        changed = before.changes()
        if changed:
            raise CodeChanged(listed(changed)) from error
        if before.look_for_new_files():  # which Python may have imported in place of others
            self._check_contents()

    def _files(self) -> list[Path]:
        """Return the files on which the result of a step depends, each once.

        They are the source of the method or scorer and of all that it imports, the data files that
        it declares, and the card and weights of its trained model.

        Raises
        ------
        CodeChanged
            If its source can no longer be found.
        """
        sources: list[Path] = []
        try:
            for target in (self._code.target, *self._code.modules):
                sources += sources_of(target)
        except (BenchmarkError, OSError) as error:
            raise _changed_code(error) from error
        folder = sources[0].parent  # declared files lie beside the source of the component
        files = [*sources, *(folder / name for name in self._code.files)]
        if self._model:
            files += [self._model / CARD, self._model / WEIGHTS]
        return list(dict.fromkeys(files))

    def _check_contents(self) -> None:
        """Check that all files have the contents of the plan.

        Raises
        ------
        CodeChanged
            If a file differs, is new or is missing; the error names it.
        """
        planned = self._code.parts  # digests by name of the file
        try:
            current = _current_parts(self._code)
            changed = [name for name, part in planned.items() if current.get(name) != part]
            changed += [name for name in current if name not in planned]
            if self._model:
                changed += _changed_files_of_model(self._model, self._card)
        except (BenchmarkError, OSError) as error:
            raise _changed_code(error) from error
        if changed:
            names = dict.fromkeys(Path(name).name for name in changed)
            raise CodeChanged(listed(names))


def _changed_code(error: BenchmarkError | OSError) -> CodeChanged:
    """Return the error for code of which a file is not found, or may not be read any more."""
    if isinstance(error, BenchmarkError):
        return CodeChanged(f"its code ({error.problem})")
    return CodeChanged(f"its code ({Path(str(error.filename)).name}: {error.strerror})")


def _changed_files_of_model(model: Path, card: str) -> list[str]:
    """Return which files of a model are not those of the plan: the card names the weights."""
    try:
        if file_digest(model / CARD, None) != card:
            return [CARD]
        if file_digest(model / WEIGHTS, None) != read_card(model).digest:
            return [WEIGHTS]
    except BenchmarkError as error:  # a file is gone, or may not be read
        return [error.file.name if error.file else CARD]
    return []


class _FileState(NamedTuple):
    """What the file system says of a file: any change of its content changes one of these."""

    inode: int
    size: int
    modified_ns: int
    changed_ns: int

    def is_recent(self) -> bool:
        """Return whether another change might get the same times."""
        age = time.time_ns() - max(self.modified_ns, self.changed_ns)
        return age < _COARSEST_CLOCK * _NANOSECONDS_PER_SECOND


class _Snapshot:
    """Files as they are at a moment; few of them are read.

    Parameters
    ----------
    files
        The files; those that are missing must stay missing.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        """Look at the state of each file and of each folder that holds some."""
        # A snapshot is taken for each step: texts are much faster than paths.
        paths = [os.fspath(file) for file in files]
        self._states = {path: _state_of(path) for path in paths}
        folders = {os.path.dirname(path) for path in paths}  # noqa: PTH120
        self._folders = {folder: _state_of(folder) for folder in folders}
        #: Digests of files that changed a moment ago: another change may leave their times alone.
        self._contents: dict[str, str] = {}
        for path, state in self._states.items():
            if state and state.is_recent():
                self._contents[path] = _content_of(path)

    def changes(self) -> list[str]:
        """Return the names of the files that changed since."""
        changed = [path for path, state in self._states.items() if _state_of(path) != state]
        changed += [path for path, text in self._contents.items() if _content_of(path) != text]
        return [Path(path).name for path in dict.fromkeys(changed)]

    def look_for_new_files(self) -> bool:
        """Look at the folders again, and return whether files may be new since the last look."""
        before = self._folders
        self._folders = {folder: _state_of(folder) for folder in before}
        return before != self._folders

    def forget_settled(self) -> None:
        """Compare the times alone of files whose next change will have another time."""
        for path in [*self._contents]:
            state = self._states[path]
            if state is None or not state.is_recent():
                del self._contents[path]


def _state_of(path: str) -> _FileState | None:
    """Return the state of a file or folder; None if it is missing."""
    try:
        status = os.stat(path)  # noqa: PTH116  # of each step
    except OSError:
        return None
    return _FileState(status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)


def _content_of(path: str) -> str:
    """Return the digest of a file; "" if it cannot be read, or is none that ends."""
    content = hashlib.sha256()
    try:
        for chunk in chunks_of(Path(path)):
            content.update(chunk)
    except OSError:
        return ""
    return content.hexdigest()


class SuiteFiles:
    """The source files of the suite since a moment, of which a process may hold others."""

    def __init__(self) -> None:
        self._snapshot = _Snapshot(suite_sources())

    def check(self) -> None:
        """Raise ``CodeChanged`` if a file changed since."""
        changed = self._snapshot.changes()
        if changed:
            raise CodeChanged(listed(changed))


def state_of_suite() -> int:
    """Return a number that any change of a source file of the suite changes."""
    states = [(str(path), _state_of(str(path))) for path in suite_sources()]
    return int(digest(states), 16)
