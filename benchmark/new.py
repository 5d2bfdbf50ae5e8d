"""Write a new method: a working file and its test."""

from __future__ import annotations

import keyword
import re
from pathlib import Path

from benchmark.code_digest import is_installed
from benchmark.errors import ConfigurationError
from benchmark.files import write_text
from benchmark.registry import by_name
from benchmark.text import EVERY, is_name

#: Method that is written under another name.
_EXAMPLE = "ray-stretch"


def new_method(name: str, folder: Path = Path()) -> list[Path]:
    """Write a small working method and its test; no file is overwritten.

    Parameters
    ----------
    name
        Name in lower case, with hyphens between words.
    folder
        Folder for ``name_with_underscores.py`` and ``test_name_with_underscores.py``; created if necessary.

    Returns
    -------
    list of pathlib.Path
        The method and its test.

    Raises
    ------
    ConfigurationError
        If the name is invalid or taken, a file exists already, or the folder cannot be written.
    """
    _check(name)
    texts: dict[Path, str] = {}
    for source in _sources():
        target, text = source.name, source.read_text("utf-8")
        for old, new in zip(_spellings(_EXAMPLE), _spellings(name), strict=True):
            target, text = target.replace(old, new), text.replace(old, new)
        texts[folder / target] = text
    for path in texts:
        if path.exists():
            raise ConfigurationError(f"{path} exists already", "choose another name or folder")
    try:
        for path, text in texts.items():
            write_text(path, text)
    except OSError as error:
        raise ConfigurationError(f"{folder} cannot be written to: {error}", "choose another folder") from error
    return list(texts)


def _spellings(name: str) -> tuple[str, str, str, str]:
    """Return a name as written on the command line, for a module, for a class, and in tables."""
    title = " ".join(word.capitalize() for word in name.split("-"))
    return name, name.replace("-", "_"), title.replace(" ", ""), title


def _sources() -> list[Path]:
    here = Path(__file__).parent  # an installed suite has the examples inside, a checkout beside
    folder = next(path for path in (here / "examples", here.parent / "examples") if path.is_dir())
    return [folder / f"{prefix}{_spellings(_EXAMPLE)[1]}.py" for prefix in ("", "test_")]


def _check(name: str) -> None:
    """Raise ``ConfigurationError`` if a name is invalid, taken, or would hide another one."""
    if not is_name(name):
        hint = f"join lower-case words by hyphens, like {_EXAMPLE}"
        raise ConfigurationError(f"'{name:.80}' cannot be the name of a method", hint)
    if name in by_name("method") or name == EVERY:
        raise ConfigurationError(f"there is already a method '{name}'", "choose another name")
    _, module, class_name, _ = _spellings(name)
    is_word = keyword.iskeyword(module) or keyword.iskeyword(class_name)
    is_used = re.search(rf"\b{class_name}\b", _sources()[0].read_text("utf-8").partition("\n\n@")[0])
    if is_word or is_used or is_installed(module):
        raise ConfigurationError(f"'{name}' has another meaning in Python", f"choose another name: my-{name}")
