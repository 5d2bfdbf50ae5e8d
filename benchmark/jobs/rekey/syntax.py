"""Two versions of a piece of code compared: what differs, once names and notes that change nothing are equal.

Equal are: docstrings, annotations inside functions and of their parameters, what an error is raised with, local names
that are renamed one to one, and names of the suite that were renamed everywhere. All else that differs is told by the
smallest expression or statement that holds it, in either version.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import Any

Function = ast.FunctionDef | ast.AsyncFunctionDef

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)

#: Statements without instructions of their own.
_SILENT = (ast.Pass, ast.Global, ast.Nonlocal)

_IGNORED_FIELDS = frozenset({"ctx", "type_comment", "kind", "type_params"})


@dataclass
class Names:
    """Names of the suite in two trees, and which of them stand for each other.

    Parameters
    ----------
    defined
        Names that each tree defines: of functions, classes, attributes, constants, modules.
    parameters
        Names of parameters of its functions.
    mentioned
        Names that each tree mentions anywhere but as locals.
    """

    defined: tuple[set[str], set[str]]
    parameters: tuple[set[str], set[str]]
    mentioned: tuple[set[str], set[str]]
    _new_of: dict[str, str] = field(default_factory=dict, init=False)
    _old_of: dict[str, str] = field(default_factory=dict, init=False)

    def same(self, old: str, new: str) -> bool:
        """Return whether two names are one, or the old one was renamed to the new one everywhere."""
        if old == new:
            return True
        if "." in old and "." in new:
            parts = old.split("."), new.split(".")
            return len(parts[0]) == len(parts[1]) and all(itertools.starmap(self.same, zip(*parts, strict=True)))
        for name, here, there in ((old, 0, 1), (new, 1, 0)):
            is_ours = name in self.defined[here] or name in self.parameters[here]
            if not is_ours or name in self.defined[there] or name in self.mentioned[there]:
                return False
        return self._new_of.setdefault(old, new) == new and self._old_of.setdefault(new, old) == old


def plain(node: ast.AST) -> ast.AST:
    """Strip a function in place of what changes nothing: docstrings, annotations, what errors are raised with."""
    for part in ast.walk(node):
        if isinstance(part, FUNCTIONS):
            part.returns = None
            if ast.get_docstring(part) is not None:
                part.body = part.body[1:] or [ast.copy_location(ast.Pass(), part.body[0])]
        if isinstance(part, ast.arg):
            part.annotation = None
        if isinstance(part, ast.Raise):
            part.cause = None
            if isinstance(part.exc, ast.Call):
                part.exc = part.exc.func
        for name in ("body", "orelse", "finalbody"):
            if isinstance(value := getattr(part, name, None), list) and not isinstance(part, ast.ClassDef):
                value[:] = [_without_annotation(each) for each in value]
    return node


def _without_annotation(statement: Any) -> Any:
    if not isinstance(statement, ast.AnnAssign):
        return statement
    made = ast.Assign([statement.target], statement.value) if statement.value else ast.Pass()
    return ast.copy_location(made, statement)


def bound_in(node: ast.AST) -> frozenset[str]:
    """Return the local names of a function, those of functions inside it among them."""
    found: set[str] = set()
    shared: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and isinstance(part.ctx, (ast.Store, ast.Del)):
            found.add(part.id)
        elif isinstance(part, ast.arg):
            found.add(part.arg)
        elif (isinstance(part, ast.ExceptHandler) and part.name) or (isinstance(part, FUNCTIONS) and part is not node):
            found.add(str(part.name))
        elif isinstance(part, ast.Global):
            shared.update(part.names)
        elif isinstance(part, ast.alias):
            shared.add(str(part.asname or part.name))
    return frozenset(found - shared)


class Comparison:
    """The differences between two versions of one function or statement.

    Parameters
    ----------
    names
        Names of the two trees.
    old, new
        The versions, stripped by :func:`plain`.
    """

    def __init__(self, names: Names, old: ast.AST, new: ast.AST) -> None:
        self._names = names
        self._locals = bound_in(old), bound_in(new)
        self._new_of: dict[str, str] = {}
        self._old_of: dict[str, str] = {}
        self.old: list[ast.AST] = []
        self.new: list[ast.AST] = []
        self._compare(old, new, old, new)

    def _add(self, old: Iterable[ast.AST], new: Iterable[ast.AST]) -> None:
        self.old += [leaf for node in old for leaf in leaves(node)]
        self.new += [leaf for node in new for leaf in leaves(node)]

    def _compare(self, old: Any, new: Any, around_old: ast.AST, around_new: ast.AST) -> None:
        if type(old) is not type(new):
            self._add([old if _is_placed(old) else around_old], [new if _is_placed(new) else around_new])
            return
        if isinstance(old, FUNCTIONS):
            self._compare_functions(old, new)
            return
        if _is_placed(old):
            around_old, around_new = old, new
        for name, value in ast.iter_fields(old):
            if name in _IGNORED_FIELDS:
                continue
            other = getattr(new, name, None)
            if isinstance(value, list):
                self._compare_lists(old, value, other or [], around_old, around_new)
            elif isinstance(value, ast.AST) and isinstance(other, ast.AST):
                self._compare(value, other, around_old, around_new)
            elif isinstance(value, str) and isinstance(other, str) and not isinstance(old, ast.Constant):
                if not self._is_same(old, value, other):
                    self._add([around_old], [around_new])
            elif type(value) is not type(other) or repr(value) != repr(other):
                self._add([around_old], [around_new])

    def _compare_functions(self, old: Function, new: Function) -> None:
        """Compare what a function does; what its head says must have been of account where the function began."""
        places = [list(_arguments(each.args)) for each in (old, new)]
        if len(places[0]) != len(places[1]):
            self._enter(old, new)
        else:
            for (one, before), (other, now) in zip(*places, strict=True):
                if not self._is_same(one, one.arg, other.arg):
                    self._enter(old, new)
                if shape(before) != shape(now) or Comparison(self._names, _list(before), _list(now)).differ:
                    self._enter(old, new)
                    self._add(_uses(old, one.arg), _uses(new, other.arg))
        heads = [_list(*each.decorator_list) for each in (old, new)]
        if shape(heads[0]) != shape(heads[1]) or Comparison(self._names, *heads).differ:
            self._enter(old, new)
        self._compare_lists(old, old.body, new.body, old.body[0], new.body[0])

    def _enter(self, old: Function, new: Function) -> None:
        """Take both functions for different as a whole: it is enough that they began."""
        self.old.append(beginning(old))
        self.new.append(beginning(new))

    @property
    def differ(self) -> bool:
        """Return whether there is a difference."""
        return bool(self.old or self.new)

    def _is_same(self, node: ast.AST, old: str, new: str) -> bool:
        if isinstance(node, (ast.Name, ast.arg, ast.ExceptHandler)):
            is_local = old in self._locals[0], new in self._locals[1]
            if all(is_local):
                return self._new_of.setdefault(old, new) == new and self._old_of.setdefault(new, old) == old
            if any(is_local):
                return False
        return self._names.same(old, new)

    def _compare_lists(
        self, parent: ast.AST, old: list[Any], new: list[Any], around_old: ast.AST, around_new: ast.AST
    ) -> None:
        if not (old and isinstance(old[0], ast.stmt)) and not (new and isinstance(new[0], ast.stmt)):
            if len(old) != len(new):
                self._add([around_old], [around_new])
                return
            for one, other in zip(old, new, strict=True):
                if isinstance(one, ast.AST) and isinstance(other, ast.AST):
                    self._compare(one, other, around_old, around_new)
                elif one != other and not (isinstance(one, str) and self._names.same(one, str(other))):
                    self._add([around_old], [around_new])
            return
        matcher = SequenceMatcher(None, list(map(shape, old)), list(map(shape, new)), autojunk=False)
        for tag, start, end, new_start, new_end in matcher.get_opcodes():
            if tag == "equal" or (tag == "replace" and end - start == new_end - new_start):
                for one, other in zip(old[start:end], new[new_start:new_end], strict=True):
                    self._compare(one, other, one, other)
            else:
                self._add(old[start:end], new[new_start:new_end])


def shape(node: Any) -> str:
    """Return a text of a piece of code in which all names are one."""
    if isinstance(node, ast.AST):
        parts = []
        for name, value in ast.iter_fields(node):
            if name in _IGNORED_FIELDS:
                continue
            is_name = isinstance(value, str) and not isinstance(node, ast.Constant)
            parts.append("_" if is_name else shape(value))
        return f"{type(node).__name__}({','.join(parts)})"
    if isinstance(node, list):
        return "[" + ",".join("_" if isinstance(part, str) else shape(part) for part in node) + "]"
    return repr(node)


def beginning(function: Function) -> ast.AST:
    """Return the part of a function that runs whenever it is called."""
    return next(leaves(function), function.body[0])


def leaves(node: ast.AST) -> Iterator[ast.AST]:
    """Return the parts of a piece of code that may run each without the others."""
    if isinstance(node, (*FUNCTIONS, ast.ClassDef)):
        for statement in node.body:
            yield from leaves(statement)
        return
    if isinstance(node, _SILENT):
        return
    if not isinstance(getattr(node, "body", None), list):
        yield node
        yield from _arms(node)
        return
    for _, value in ast.iter_fields(node):
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, (ast.stmt, ast.ExceptHandler, ast.match_case)):
                yield from leaves(part)
            elif isinstance(part, ast.withitem):
                yield part.context_expr
            elif isinstance(part, ast.expr):
                yield part
                yield from _arms(part)


def _arms(node: ast.AST) -> Iterator[ast.AST]:
    """Parts of an expression that do not run whenever it does."""
    for part in ast.walk(node):
        if isinstance(part, ast.IfExp):
            yield from (part.body, part.orelse)
        elif isinstance(part, ast.BoolOp):
            yield from part.values[1:]
        elif isinstance(part, ast.Lambda):
            yield part.body
        elif isinstance(part, (ast.ListComp, ast.SetComp, ast.GeneratorExp)):
            yield part.elt
        elif isinstance(part, ast.DictComp):
            yield part.value


def _arguments(arguments: ast.arguments) -> Iterator[tuple[ast.arg, ast.expr | None]]:
    """Parameters with their defaults."""
    plain_ones = [*arguments.posonlyargs, *arguments.args]
    blanks = [None] * (len(plain_ones) - len(arguments.defaults))
    yield from zip(plain_ones, [*blanks, *arguments.defaults], strict=True)
    yield from zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True)
    yield from ((each, None) for each in (arguments.vararg, arguments.kwarg) if each)


def _uses(function: Function, name: str) -> list[ast.AST]:
    return [part for part in ast.walk(function) if isinstance(part, ast.Name) and part.id == name]


def _list(*nodes: ast.expr | None) -> ast.List:
    return ast.List([node for node in nodes if node is not None], ast.Load(), lineno=0, col_offset=0)


def _is_placed(node: Any) -> bool:
    return isinstance(node, ast.AST) and hasattr(node, "lineno") and not isinstance(node, (ast.arg, ast.keyword))
