"""Regions of the suite that differ between two trees and must have run for a sample to tell whether that matters.

Functions are compared with those of the same name, or with those of another one that look alike: renamed or moved.
A constant, a field of a class or an import that differs is of account where its name is used. A moved statement, as
where a function was split, is none that differs.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmark.jobs.rekey.reached import Region
from benchmark.jobs.rekey.syntax import (
    FUNCTIONS,
    Comparison,
    Function,
    Names,
    beginning,
    bound_in,
    leaves,
    plain,
    shape,
)
from benchmark.jobs.rekey.trees import Tree

OLD, NEW = 0, 1

#: Decorators of functions that the interpreter does not run; their parts are told by a run without compilation.
_COMPILERS = ("njit", "jit", "vectorize", "guvectorize")


@dataclass(frozen=True)
class Change:
    """A region that differs.

    Parameters
    ----------
    tree
        0: the region is of the old tree. 1: of the new one.
    module, function
        Where it is; ``function`` is "" outside of functions.
    file
        The source, relative to the root of the tree.
    region
        Lines and columns.
    is_compiled
        Whether it is part of a compiled kernel.
    """

    tree: int
    module: str
    function: str
    file: str
    region: Region
    is_compiled: bool

    @property
    def name(self) -> str:
        """Name under which the region is watched for."""
        return f"{self.file}:{','.join(map(str, self.region))}"

    @property
    def told(self) -> str:
        """Return where it is, in words."""
        tree = ("before", "now")[self.tree]
        return f"{self.module}{self.function and '.' + self.function}, line {self.region[0]} ({tree})"


@dataclass
class _Module:
    """Definitions of a module."""

    name: str
    file: str
    functions: dict[str, Function] = field(default_factory=dict)
    constants: dict[str, ast.stmt] = field(default_factory=dict)
    imports: dict[str, tuple[str, str]] = field(default_factory=dict)

    @classmethod
    def read(cls, name: str, path: Path, root: Path) -> _Module:
        found = cls(name, str(path.relative_to(root)))
        found._take(ast.parse(path.read_bytes()).body, "")
        return found

    def _take(self, statements: Iterable[ast.stmt], prefix: str) -> None:
        for statement in statements:
            if isinstance(statement, FUNCTIONS):
                plain(statement)
                self.functions[prefix + statement.name] = statement
            elif isinstance(statement, ast.ClassDef):
                self.constants[f"{prefix}{statement.name}."] = _head(statement)
                self._take(statement.body, f"{prefix}{statement.name}.")
            elif isinstance(statement, (ast.If, ast.Try)):
                self._take([*statement.body, *statement.orelse], prefix)
            elif isinstance(statement, ast.ImportFrom):
                origin = "." * statement.level + (statement.module or "")
                self.imports |= {alias.asname or alias.name: (origin, alias.name) for alias in statement.names}
            elif isinstance(statement, ast.Import):
                self.imports |= {alias.asname or alias.name: (alias.name, "") for alias in statement.names}
            elif isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
                for name in _targets(statement):
                    self.constants[prefix + name] = statement

    def is_compiled(self, function: str) -> bool:
        """Return whether a function is a compiled kernel."""
        decorators = self.functions[function].decorator_list if function else []
        return any(word in ast.unparse(each) for each in decorators for word in _COMPILERS)


def _head(statement: ast.ClassDef) -> ast.stmt:
    """Bases, keywords and decorators of a class."""
    parts = [*statement.bases, *(each.value for each in statement.keywords), *statement.decorator_list]
    return ast.copy_location(ast.Expr(ast.copy_location(ast.List(parts, ast.Load()), statement)), statement)


def _targets(statement: ast.Assign | ast.AnnAssign | ast.AugAssign) -> Iterator[str]:
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    for target in targets:
        yield from (part.id for part in ast.walk(target) if isinstance(part, ast.Name) and part.id != "__all__")


def changes(old: Tree, new: Tree) -> list[Change]:
    """List the regions that differ between two trees."""
    return _Differences(old, new).found()


class _Differences:
    def __init__(self, old: Tree, new: Tree) -> None:
        sources = old.sources(), new.sources()
        self._all = tuple(
            {name: _Module.read(name, path, tree.root) for name, path in found.items()}
            for tree, found in zip((old, new), sources, strict=True)
        )
        texts = [{name: path.read_bytes() for name, path in found.items()} for found in sources]
        self._touched = [
            {name for name, text in texts[tree].items() if texts[1 - tree].get(name) != text} for tree in (OLD, NEW)
        ]
        old_names, new_names = map(_names, self._all)
        self._names = Names(*zip(old_names, new_names, strict=True))
        self._found: list[tuple[int, str, str, ast.AST]] = []
        #: Names whose meaning differs, by tree and module.
        self._changed: list[set[tuple[str, str]]] = [set(), set()]

    def found(self) -> list[Change]:
        """Compare all that is in modules that differ."""
        pairs = self._pairs()
        for (module, name), (other, other_name) in pairs.items():
            versions = self._all[OLD][module].functions[name], self._all[NEW][other].functions[other_name]
            compared = Comparison(self._names, *versions)
            self._add(OLD, module, name, compared.old)
            self._add(NEW, other, other_name, compared.new)
            if module != other and not self._keeps_globals((module, name), (other, other_name), pairs):
                self._add(OLD, module, name, [beginning(versions[OLD])])
                self._add(NEW, other, other_name, [beginning(versions[NEW])])
        for tree, partners in ((OLD, set(pairs)), (NEW, set(pairs.values()))):
            for module in self._touched[tree]:
                for name, function in self._all[tree][module].functions.items():
                    if (module, name) not in partners and self._is_reachable(tree, module, name):
                        self._add(tree, module, name, leaves(function))
        self._compare_constants()
        self._compare_imports(pairs)
        self._add_uses()
        return self._without_moved()

    def _keeps_globals(self, old: tuple[str, str], new: tuple[str, str], pairs: Mapping[tuple[str, str], Any]) -> bool:
        """Return whether each global name of a function means the same in the module that it moved to."""
        if self._names.same(old[0], new[0]):
            return True
        places = self._all[OLD][old[0]], self._all[NEW][new[0]]
        used = [_globals_of(place.functions[name]) for place, (_, name) in zip(places, (old, new), strict=True)]
        return used[OLD] == used[NEW] and all(
            pairs.get((old[0], name)) == (new[0], name)
            or (name in places[OLD].imports and places[OLD].imports.get(name) == places[NEW].imports.get(name))
            or any(
                each in places[OLD].constants and self._counterpart(old[0], each) == (new[0], each)
                for each in (name, f"{name}.")
            )
            or not any(_defines(place, name) for place in places)
            for name in used[OLD]
        )

    def _add(self, tree: int, module: str, function: str, nodes: Iterable[ast.AST]) -> None:
        self._found += [(tree, module, function, node) for node in nodes if hasattr(node, "end_lineno")]

    def _is_reachable(self, tree: int, module: str, function: str) -> bool:
        """Return whether anything mentions a function by its name, or its class inherits from one that may call it."""
        owner, _, leaf = function.rpartition(".")
        head = self._all[tree][module].constants.get(f"{owner}.")
        inherits = isinstance(head, ast.Expr) and isinstance(head.value, ast.List) and bool(head.value.elts)
        return leaf.startswith("__") or inherits or leaf in self._names.mentioned[tree]

    def _pairs(self) -> dict[tuple[str, str], tuple[str, str]]:
        """Functions of modules that differ with what has become of them."""
        pairs: dict[tuple[str, str], tuple[str, str]] = {}
        left: list[dict[tuple[str, str], Function]] = [{}, {}]
        for tree in (OLD, NEW):
            for module in self._touched[tree]:
                for name, function in self._all[tree][module].functions.items():
                    other = self._all[1 - tree].get(module)
                    if other is None or name not in other.functions:
                        left[tree][module, name] = function
                    elif tree == OLD:
                        pairs[module, name] = (module, name)
        looks: dict[str, list[tuple[str, str]]] = {}
        for place, function in left[NEW].items():
            looks.setdefault(_look(function), []).append(place)
        for place, function in left[OLD].items():
            alike = looks.get(_look(function), [])
            # Of several that look alike, one with the same name, then one of the same module.
            ranks = [(other[1] != place[1], other[0] != place[0], other) for other in alike]
            if ranks:
                pairs[place] = min(ranks)[2]
                alike.remove(pairs[place])
        return pairs

    def _compare_constants(self) -> None:
        for module in self._touched[OLD]:
            for name, statement in self._all[OLD][module].constants.items():
                other, other_name = self._counterpart(module, name)
                there = self._all[NEW].get(other)
                if there is None or other_name not in there.constants:
                    continue  # whoever used it differs
                if Comparison(self._names, statement, there.constants[other_name]).differ or shape(statement) != shape(
                    there.constants[other_name]
                ):
                    self._changed[OLD].add((module, name))
                    self._changed[NEW].add((other, other_name))

    def _counterpart(self, module: str, name: str) -> tuple[str, str]:
        """Return where a constant of the old tree is now: in place, renamed, or in the one module that gained it."""
        here = self._all[NEW].get(module)
        if here and name in here.constants:
            return module, name
        gained = [
            (other, found)
            for other in self._touched[NEW]
            for found in self._all[NEW][other].constants
            if (other not in self._all[OLD] or found not in self._all[OLD][other].constants)
            and self._names.same(name.rstrip("."), found.rstrip("."))
        ]
        return next((place for place in gained if place[0] == module), gained[0] if len(gained) == 1 else ("", ""))

    def _compare_imports(self, pairs: Mapping[tuple[str, str], tuple[str, str]]) -> None:
        for module in self._touched[OLD] & self._touched[NEW]:
            before, now = self._all[OLD][module].imports, self._all[NEW][module].imports
            for name in before.keys() & now.keys():
                one, other = before[name], now[name]
                if one == other or pairs.get(one) == other:
                    continue
                is_renamed = self._names.same(one[0], other[0]) and self._names.same(one[1], other[1])
                if not is_renamed and self._origin(OLD, one) != self._origin(NEW, other):
                    self._changed[OLD].add((module, name))
                    self._changed[NEW].add((module, name))

    def _origin(self, tree: int, target: tuple[str, str]) -> str:
        """Text of what an import brings: of the suite, its definition; else its name."""
        module = self._all[tree].get(target[0])
        for _ in range(len(self._all[tree])):
            if module is None or target[1] not in module.imports:
                break
            target = module.imports[target[1]]
            module = self._all[tree].get(target[0])
        if module is None:
            return repr(target)
        found = module.functions.get(target[1]) or module.constants.get(target[1])
        if found is not None:
            return ast.dump(found)
        parts = {name: each for kind in (module.functions, module.constants) for name, each in kind.items()}
        inside = {name: ast.dump(each) for name, each in parts.items() if name.startswith(f"{target[1]}.")}
        return repr(inside) if inside else repr(target)

    def _add_uses(self) -> None:
        """Add the places where names are used whose meaning differs, of constants that are made of them as well."""
        for tree in (OLD, NEW):
            pending, done = list(self._changed[tree]), set(self._changed[tree])
            while pending:
                origin, name = pending.pop()
                is_field = "." in name
                leaf = name.rstrip(".").rpartition(".")[2]
                for module in self._all[tree].values():
                    local = {leaf} if module.name == origin else set()
                    local |= {as_name for as_name, target in module.imports.items() if target == (origin, leaf)}
                    knows = bool(local) or any(origin in (t[0], f"{t[0]}.{t[1]}") for t in module.imports.values())
                    for function, node in module.functions.items():
                        other = self._all[1 - tree].get(module.name)
                        is_in_both = other is not None and function in other.functions
                        if is_in_both or self._is_reachable(tree, module.name, function):
                            self._add(tree, module.name, function, _mentions(node, local, leaf, knows or is_field))
                    for constant, statement in module.constants.items():
                        place = (module.name, constant)
                        if place not in done and any(_mentions(statement, local, leaf, knows)):
                            done.add(place)
                            pending.append(place)

    def _without_moved(self) -> list[Change]:
        """The changes without statements that went from one function to another one as they are."""
        counts = [Counter[str](), Counter[str]()]
        texts = [ast.dump(node) if isinstance(node, ast.stmt) else "" for _, _, _, node in self._found]
        homes: list[dict[str, set[str]]] = [{}, {}]
        for (tree, _, function, _), text in zip(self._found, texts, strict=True):
            if text:
                counts[tree][text] += 1
                homes[tree].setdefault(text, set()).add(function)
        found: dict[tuple[int, str], Change] = {}
        for (tree, module, function, node), text in zip(self._found, texts, strict=True):
            elsewhere = text and homes[1 - tree].get(text, set()) - homes[tree][text]
            if elsewhere and counts[OLD][text] == counts[NEW][text]:
                continue
            known = self._all[tree][module]
            region = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]
            change = Change(tree, module, function, known.file, region, known.is_compiled(function))
            found[tree, change.name] = change
        return sorted(found.values(), key=lambda change: (change.module, change.region, change.tree))


def _globals_of(function: Function) -> set[str]:
    local = bound_in(function)
    names = {part.id for part in ast.walk(function) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load)}
    return names - local


def _defines(module: _Module, name: str) -> bool:
    return (
        name in module.functions or name in module.imports or not module.constants.keys().isdisjoint((name, f"{name}."))
    )


def _look(function: Function) -> str:
    return shape([function.args, *function.body])


def _mentions(node: ast.AST, local: set[str], leaf: str, by_attribute: bool) -> Iterator[ast.AST]:
    """Places in a piece of code where a name is used."""
    for part in ast.walk(node):
        is_name = isinstance(part, ast.Name) and part.id in local and isinstance(part.ctx, ast.Load)
        is_attribute = by_attribute and isinstance(part, ast.Attribute) and part.attr == leaf
        if is_name or is_attribute:
            yield part


def _names(modules: Mapping[str, _Module]) -> tuple[set[str], set[str], set[str]]:
    """Names that a tree defines, those of parameters, and those that it mentions but as locals."""
    defined: set[str] = set()
    parameters: set[str] = set()
    mentioned: set[str] = set()
    for module in modules.values():
        defined.update(module.name.split("."))
        for name in (*module.functions, *module.constants):
            defined.update(name.rstrip(".").split("."))
        for origin, name in module.imports.values():
            mentioned.update([*origin.split("."), name])
        for node in (*module.functions.values(), *module.constants.values()):
            local = bound_in(node) if isinstance(node, FUNCTIONS) else frozenset()
            for part in ast.walk(node):
                if isinstance(part, ast.arg):
                    parameters.add(part.arg)
                elif isinstance(part, ast.Attribute):
                    (defined if isinstance(part.ctx, ast.Store) else mentioned).add(part.attr)
                elif isinstance(part, ast.keyword) and part.arg:
                    mentioned.add(part.arg)
                elif isinstance(part, ast.Name) and part.id not in local and isinstance(part.ctx, ast.Load):
                    mentioned.add(part.id)
                elif isinstance(part, ast.Constant) and isinstance(part.value, str) and part.value.isidentifier():
                    mentioned.add(part.value)
    return defined, parameters, mentioned
