"""What a step makes is kept only if the files that its key names were those of the plan all the while.

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
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from benchmark.api.learning import CARD, WEIGHTS, read_card
from benchmark.code_digest import code_of, code_of_modules, sources_of
from benchmark.errors import BenchmarkError
from benchmark.files import file_digest
from benchmark.text import listed

#: Seconds between two changes of a file that some file systems do not tell apart.
_COARSEST_CLOCK = 2.0


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
    return code._replace(parts=_parts_of(code))


def _parts_of(code: PlannedCode) -> dict[str, str]:
    return code_of(code.target, code.files) | code_of_modules(code.modules)


class PlannedFiles:
    """The files on which steps depend, which must be those of the plan before and after each of them.

    Parameters
    ----------
    code
        What the plan saw.
    model, card
        Folder of the trained model, and the digest of its card when the run was planned.
    """

    def __init__(self, code: PlannedCode, model: Path | None = None, card: str = "") -> None:
        self._code, self._model, self._card = code, model, card
        #: The look at which all contents were those of the plan.
        self._confirmed: _Look | None = None

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
            self._check_against(before, error)
            raise
        self._check_against(before)

    def _confirm(self) -> _Look:
        """Return a look at the files with the contents of the plan."""
        known = self._confirmed
        if known is not None and not known.changes() and not known.new_files():
            known.forget_settled()
            return known
        look = _Look(self._files())
        self._check_contents()
        if names := look.changes():
            raise CodeChanged(listed(names))
        self._confirmed = look
        return look

    def _check_against(self, before: _Look, error: BaseException | None = None) -> None:
        """Raise ``CodeChanged`` if a file changed since a look, also if it was put back."""
        if names := before.changes():
            raise CodeChanged(listed(names)) from error
        if before.new_files():  # which Python may have imported in place of others
            self._check_contents()

    def _files(self) -> list[Path]:
        code = self._code
        try:
            sources = [path for of in (code.target, *code.modules) for path in sources_of(of)]
        except BenchmarkError as error:
            raise CodeChanged(f"its code ({error.problem})") from error
        declared = [sources[0].parent / name for name in code.files]
        of_model = [self._model / name for name in (CARD, WEIGHTS)] if self._model else []
        return [*dict.fromkeys([*sources, *declared, *of_model])]

    def _check_contents(self) -> None:
        planned = self._code.parts
        try:
            now = _parts_of(self._code)
            changed = [name for name, part in planned.items() if now.get(name) != part]
            changed += [name for name in now if name not in planned]
            if self._model:
                changed += _changed_of_model(self._model, self._card)
        except BenchmarkError as error:
            raise CodeChanged(f"its code ({error.problem})") from error
        if changed:
            raise CodeChanged(listed(dict.fromkeys(Path(name).name for name in changed)))


def _changed_of_model(model: Path, card: str) -> list[str]:
    """Return which files of a model are not those of the plan: the card names the weights."""
    if file_digest(model / CARD, None) != card:
        return [CARD]
    weights = file_digest(model / WEIGHTS, None)
    return [] if weights == read_card(model).digest else [WEIGHTS]


class _Look:
    """What a look at files saw, without reading them.

    Parameters
    ----------
    files
        The files; those that are missing are seen to be missing.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        self._states = {os.fspath(file): _state(os.fspath(file)) for file in files}
        folders = {os.path.dirname(file) for file in self._states}  # noqa: PTH120  # of each step
        self._folders = {folder: _state(folder) for folder in folders}
        recent = time.time_ns() - int(_COARSEST_CLOCK * 1e9)
        #: Contents of the files whose times may be the same after another change.
        self._contents = {
            file: _content(file)
            for file, state in self._states.items()
            if state and max(state[2:]) > recent
        }

    def changes(self) -> list[str]:
        """Return the names of the files that changed since."""
        changed = [file for file, state in self._states.items() if _state(file) != state]
        changed += [file for file, content in self._contents.items() if _content(file) != content]
        return [Path(file).name for file in dict.fromkeys(changed)]

    def new_files(self) -> bool:
        """Return whether there may be files in their folders that were not there; then the look sees these."""
        before, self._folders = self._folders, {of: _state(of) for of in self._folders}
        return before != self._folders

    def forget_settled(self) -> None:
        """Read the contents of files no more whose next change will have another time."""
        recent = time.time_ns() - int(_COARSEST_CLOCK * 1e9)
        for file in [*self._contents]:
            state = self._states[file]
            if state is None or max(state[2:]) <= recent:
                del self._contents[file]


def _state(file: str) -> tuple[int, int, int, int] | None:
    with suppress(OSError):
        facts = os.stat(file)  # noqa: PTH116  # of each step
        return facts.st_ino, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns
    return None


def _content(file: str) -> str:
    with suppress(OSError), open(file, "rb") as stream:  # noqa: PTH123  # of each step
        return hashlib.file_digest(stream, "sha256").hexdigest()
    return ""
