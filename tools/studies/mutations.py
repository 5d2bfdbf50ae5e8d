"""Random mutations of keyed modules: does ``rekey`` let one pass that changes a result?

    python -m tools.studies.mutations --count 100 -o mutations.json

Each mutation (a constant, an operator, the order of two statements) is committed to a copy of the suite that has made
a small gallery. Where ``rekey`` moves all rows, the gallery is made anew by the mutated code, and each stage of a row
is compared with the original by its digest. The file grows by a line for each mutation, and a study that was stopped
goes on.
"""

from __future__ import annotations

import argparse
import ast
import json
import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from benchmark.system.fingerprints import IGNORED
from tests.jobs.rekey.copies import Copy

CHOSEN = ("-m", "classic-mds", "-m", "gps", "-m", "least-squares-mds", "-m", "identity", "-m", "shape-dna")
BENDS = (0.0, 0.7, 1.2, 2.4)

SWAPPED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.LtE, ast.LtE: ast.Lt,
    ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip


def sites(tree: ast.Module) -> Iterator[tuple[str, ast.AST, ast.AST]]:
    """Kind, node and what may take its place, for each place of a module that can be mutated."""
    annotations = {
        id(part)
        for node in ast.walk(tree)
        for name in ("annotation", "returns", "decorator_list")
        if (found := getattr(node, name, None))
        for each in (found if isinstance(found, list) else [found])
        for part in ast.walk(each)
    }
    for node in ast.walk(tree):
        if id(node) in annotations:
            continue
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            yield (
                "constant",
                node,
                ast.Constant(node.value + 1 if type(node.value) is int else node.value * 1.001 + 1e-9),
            )
        elif isinstance(node, ast.BinOp) and type(node.op) in SWAPPED:
            yield "operator", node, ast.BinOp(node.left, SWAPPED[type(node.op)](), node.right)
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPPED and len(node.ops) == 1:
            yield "operator", node, ast.Compare(node.left, [SWAPPED[type(node.ops[0])]()], node.comparators)
        elif isinstance(node, ast.FunctionDef):
            for one, other in zip(node.body, node.body[1:], strict=False):
                if all(isinstance(each, (ast.Assign, ast.AugAssign)) for each in (one, other)):
                    yield "order", ast.copy_location(ast.Tuple([one, other]), one), ast.Tuple([other, one])


def mutated(text: str, node: ast.AST, instead: ast.AST) -> str:
    """The source with one node replaced."""
    lines = text.encode().splitlines(keepends=True)
    if isinstance(node, ast.Tuple):  # two statements
        one, other = node.elts
        first, second = (lines[each.lineno - 1 : each.end_lineno] for each in (one, other))
        lines[one.lineno - 1 : other.end_lineno] = [*second, *lines[one.end_lineno : other.lineno - 1], *first]
        return b"".join(lines).decode()
    start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    whole = text.encode()
    return (whole[:start] + f"({ast.unparse(instead)})".encode() + whole[end:]).decode()


def outcome(copy: Copy, kept: Path) -> tuple[str, str]:
    """What ``rekey`` said of the last commit, and where it moved all rows, whether it was right."""
    code, said = copy.run("rekey", "--from", "HEAD~1", "-j", "1")
    reason = next((line for line in said.splitlines() if line.startswith(("stays", "not run", "error"))), "")
    if code != 0:
        kind = "not run by any sample" if "no sample runs" in said else "differs" if code == 1 else "no answer"
        return kind, reason
    anew = kept.with_name("anew")
    shutil.rmtree(anew, ignore_errors=True)
    copy.run("run", *copy.selection, results=anew)
    found = copy.run("compare", "--digests", str(kept), str(anew))[1].splitlines()
    different = [line for line in found if "differ" in line and not line.endswith("do not tell")]
    total = found[-1] if found else "nothing to compare"
    is_right = not different and total.split()[0] == str(len(copy.records()))
    return ("equal" if is_right else "WRONG"), total


def main() -> None:
    """Try mutations until there are as many as are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--out", type=Path, required=True)
    options = parser.parse_args()
    done = options.out.read_text().splitlines() if options.out.exists() else []
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder), BENDS, CHOSEN)
        kept = Path(folder) / "kept"
        shutil.copytree(copy.results, kept)
        modules = sorted({
            name for record in copy.records() for stage in record["recipe"]["code"].values() for name in stage["code"]
        } - IGNORED)  # fmt: skip
        choose = random.Random(options.seed)
        for number in range(options.count):
            path, found = None, []
            while not found:
                name = choose.choice(modules)
                path = copy.root.joinpath(*name.split(".")).with_suffix(".py")
                found = list(sites(ast.parse(path.read_text()))) if path.is_file() else []
            kind, node, instead = choose.choice(found)
            if number < len(done):
                continue
            before = path.read_text()
            path.write_text(mutated(before, node, instead))
            copy.commit()
            result, reason = outcome(copy, kept)
            line = {"module": name, "line": node.lineno, "kind": kind, "result": result, "said": reason[:200]}
            with options.out.open("a") as file:
                file.write(json.dumps(line) + "\n")
            print(number, line, flush=True)
            copy.git("reset", "-q", "--hard", "first")
            shutil.rmtree(copy.results)
            shutil.copytree(kept, copy.results)
    counts = Counter(json.loads(line)["result"] for line in options.out.read_text().splitlines())
    print(dict(counts))


if __name__ == "__main__":
    main()
