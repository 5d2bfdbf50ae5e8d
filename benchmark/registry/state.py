"""What a method or scorer that a Python program passes depends on beside files and parameters."""

from __future__ import annotations

import dataclasses
import dis
import functools
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MemberDescriptorType, ModuleType
from typing import Any

import numpy as np

from benchmark.api.parameters import parameter_values
from benchmark.code_digest import digest, is_installed
from benchmark.errors import ConfigurationError

_REMEDY = "write a dataclass with parameters: see 'A method' in docs/reference/plugins.md"


def state_of(value: Any) -> dict[str, str]:
    """Return code and constants that an object of the user reads, by name; nothing for an object of a package.

    Raises
    ------
    ConfigurationError
        If it depends on anything else, such as variables of a function around it, globals that may change, or
        attributes that do not follow from its parameters.
    """
    _check_attributes(value)
    state, pending = dict[str, str](), list[Any]([type(value)])
    for item in pending:  # which grows
        if is_installed(item.__module__ or ""):
            continue
        if isinstance(item, FunctionType):
            state[item.__qualname__] = _digest(item.__code__)
        for name, read in _reads(item):
            parts = _parts(read)
            if parts is not None:
                pending += [part for part in parts if part not in pending]
            elif _is_constant(read):
                state[f"{item.__qualname__} {name}"] = repr(read)
            else:
                problem = f"'{item.__qualname__}' depends on '{name}', of type {type(read).__name__}, which may change"
                raise ConfigurationError(problem, _REMEDY)
    return state


def _check_attributes(value: Any) -> None:
    """Raise ``ConfigurationError`` unless the attributes of an object follow from its parameters."""
    cls, parameters = type(value), parameter_values(value)
    for name, held in parameters.items():
        if not _is_constant(held):
            problem = f"parameter '{name}' of {cls.__name__} is of type {type(held).__name__}"
            raise ConfigurationError(problem, "pass a number, a text, or a tuple of them")
    attributes = _attributes(value)
    expected = _attributes(cls(**parameters)) if attributes and dataclasses.is_dataclass(cls) else {}
    for name, held in attributes.items():
        if name not in expected or not _equal(held, expected[name]):
            problem = f"attribute '{name}' of {cls.__name__} does not follow from parameters of a dataclass"
            raise ConfigurationError(problem, _REMEDY)


def _attributes(value: Any) -> dict[str, Any]:
    slots = [vars(cls).get("__slots__", ()) for cls in type(value).__mro__]
    names = [name for names in slots for name in ([names] if isinstance(names, str) else names)]
    return {name: getattr(value, name) for name in names if hasattr(value, name)} | getattr(value, "__dict__", {})


def _equal(held: Any, expected: Any) -> bool:
    try:
        return type(held) is type(expected) and bool(held == expected)
    except Exception:  # such as arrays in a dictionary
        return False


def _is_constant(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return value is None or isinstance(value, int | float | complex | str | bytes | Enum | Path | np.generic)


def _parts(value: Any) -> list[Any] | None:
    """Return the functions and classes of a name that stands for code; None if it stands for something else."""
    if isinstance(value, type | FunctionType):
        return [value]
    if isinstance(value, staticmethod | classmethod | functools._lru_cache_wrapper):
        return [value.__wrapped__]
    if isinstance(value, property | functools.cached_property):
        return [value.fget if isinstance(value, property) else value.func]
    if hasattr(value, "py_func"):  # a compiled kernel
        return [value.py_func]
    is_function = callable(value) and hasattr(value, "__name__") and is_installed(value.__module__ or "")
    is_code = isinstance(value, ModuleType | BuiltinFunctionType | np.ufunc | MemberDescriptorType)
    return [] if is_function or is_code else None


def _reads(item: Any) -> Iterator[tuple[str, Any]]:
    """Yield bases and attributes of a class, but those that Python makes, or what a function reads, by name."""
    if not isinstance(item, FunctionType):
        yield from ((base.__name__, base) for base in item.__bases__)
        for name, value in vars(item).items():
            file = value.__code__.co_filename if isinstance(value, FunctionType) else "<string>"
            is_made = name.startswith("__") and file in ("<string>", dataclasses.__file__)
            if not is_made and name not in ("info", "_abc_impl"):
                yield name, value
        return
    if around := set(item.__code__.co_freevars) - {"__class__"}:
        problem = f"'{item.__qualname__}' depends on '{min(around)}', a variable of the function around it"
        raise ConfigurationError(problem, _REMEDY)
    yield from zip(item.__code__.co_varnames, item.__defaults__ or (), strict=False)
    yield from {**(item.__kwdefaults__ or {}), **vars(item)}.items()
    yield from _globals(item.__code__, item.__globals__)


def _globals(code: CodeType, known: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the globals that code reads or sets, and the attributes that it reads of modules of the user."""
    name, read = "", None
    for step in dis.get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME") and step.argval in known:
            name, read = step.argval, known[step.argval]
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(read, ModuleType):
            name = f"{name}.{step.argval}"
            read = None if is_installed(read.__name__) else getattr(read, step.argval, None)
        elif step.opname == "STORE_GLOBAL":
            name, read = step.argval, [...]  # which may change
        else:
            name, read = "", None
        if name:
            yield name, read
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _globals(constant, known)


def _digest(code: CodeType) -> str:
    """Return the digest of compiled code without the names of files and the numbers of lines."""
    parts = [_digest(part) if isinstance(part, CodeType) else part for part in code.co_consts]
    texts = [sorted(map(repr, part)) if isinstance(part, frozenset) else repr(part) for part in parts]
    return digest([code.co_code.hex(), code.co_names, code.co_varnames, texts])
