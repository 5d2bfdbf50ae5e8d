"""Forge records by structure, with right checksums: each must be refused by name, or give its own
figures.

``python -m tests.forge SEED COUNT FOLDER`` runs every verb on them and prints what they said. The
folder gets the records that end a verb in an error or show another figure. Started again, it goes
on where it was stopped."""

from __future__ import annotations

import copy
import io
import json
import math
import random
import re
import shutil
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec
from typer.testing import CliRunner

from benchmark import open_results
from benchmark.cli.main import cli
from benchmark.code_digest import digest, digest_of_bytes
from benchmark.errors import BenchmarkError
from benchmark.files import write_text
from benchmark.pipeline import record_files
from benchmark.pipeline.record_files import (
    encode_record,
    local_files,
    parse_record,
    scan_files,
    write_record,
)
from benchmark.pipeline.record_layout import RecordError
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TABLE_MEASURES
from benchmark.report.record_facts import row_of
from tests.report.records import record
from tests.toy import write_rods
from tests.verbs import call
from tools import publish as publishing

Content = dict[str, Any]

#: What stands where something else belongs.
STRANGE: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1,
    2,
    0.5,
    -0.25,
    1.0000001,
    1e308,
    5e-324,
    2**31,
    2**53 + 1,
    2**63,
    2**64,
    "",
    " ",
    "0",
    "NaN",
    "x" * 40_000,
    "/" + "x" * 300,
    "/" + "x/" * 9000,
    "../../etc/passwd",
    "\0",
    "\x1b[2J",
    "\u2028",
    "\u202e",
    "\ud7ff\ue000",
    "a\nb",
    "<script>alert(1)</script>",
    "\\input{/etc/passwd}",
    "100 % & _ # $ { } ~ ^ \\",
    "| a | b |",
    "[a](javascript:b)",
    "{0}{}",
    "%s",
    "[power=",
    "gps[power=2]",
    "gps[power=2]]",
    "fold 0",
    "tosca",
    [],
    [None],
    [[]],
    [0],
    ["cat0"],
    {},
    {"": 0},
    {"a": {"b": {"c": []}}},
    {"NN": 0.5},
    {"mean": 1, "max": 0},
)

#: Fields of texts that contradict nothing.
NAMES = (
    "method",
    "title",
    "family",
    "scorer",
    "scorer_title",
    "cite",
    "reason",
    "finished",
    "commit",
    "traceback",
    "gallery_digest",
)


def bases() -> list[Content]:
    """Return records of all kinds, of which forgeries are made."""
    values = [0.0 if number == 3 else 0.5 for number in range(12)]
    of_refused = {
        "per_query": dict.fromkeys(TABLE_MEASURES, values),
        "scores": dict.fromkeys(TABLE_MEASURES, sum(values) / 12),
    }
    network = {
        "models": [{"training": "people", "data": "people", "digest": "1" * 16}],
        "seen": ["cat0", "cat1"],
    }
    of_rods = {"name": "rods", "title": "rods", "source": "rods"}
    files = {"forms": [f"{number:032x}" for number in range(12)]}
    every = [
        record("gps", 0.25),
        record("gps[power=2]", 0.5, parameters={"power": 2}, defaults={"scale": 1.0}),
        record("skeleton", unsupported=[("cat3", "it is /a/b: too big")], **of_refused),
        record("learned", 0.75, **network),
        record("surface-area", 0.5, scorer=""),
        record("identity", 0.5, input_="view", files=files),
        record("gone", 0.5, data={**of_rods, "path": "/gone/rods"}),
        record("merged", 0.5, merged_from={"folder": "a/b", "plugins": {"m.py": "1" * 16}}),
        record("external-theirs", 0.5, family="external", scorer=""),
        record("classic-mds", 0.5, dataset="tosca"),
        record("classic-mds", 0.5, dataset="animals[noise=1]"),
        record("fast-mds", 0.5, notes={"bridges": {"mean": 1.0, "max": 2.0}}, cite="elad2003"),
        record("failing", status="failed", reason="it fell", scores={}, per_query={}),
        record("cross", 0.5, fold="against complete surfaces", against=_gallery()),
    ]
    return [msgspec.json.decode(encode_record(each)) for each in every]


def _gallery() -> Content:
    side = msgspec.to_builtins(record())
    names = ("gallery_digest", "shapes", "labels", "data")
    return {name: side[name] for name in names} | {"gallery": "rods", "input": "mesh", "views": 12}


def places(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of each value within a content."""
    if path:
        yield path
    if isinstance(content, Mapping):
        for name, value in content.items():
            yield from places(value, (*path, name))
    elif isinstance(content, list):
        for number, value in enumerate(content):
            yield from places(value, (*path, number))


def at(content: Any, path: tuple[Any, ...]) -> Any:
    for step in path:
        content = content[step]
    return content


def some_place(content: Content, chance: random.Random) -> tuple[Any, ...]:
    """Return the path of a value; those near the top are as frequent as the many below."""
    every = [*places(content)]
    depth = chance.choice(sorted({len(path) for path in every}))
    return chance.choice([path for path in every if len(path) == depth])


# Kinds of forgeries
# ------------------------------------------------------------------------------------------------


def replace_value(content: Content, chance: random.Random) -> None:
    path = some_place(content, chance)
    at(content, path[:-1])[path[-1]] = copy.deepcopy(chance.choice(STRANGE))


def remove_value(content: Content, chance: random.Random) -> None:
    path = some_place(content, chance)
    del at(content, path[:-1])[path[-1]]


def add_field(content: Content, chance: random.Random) -> None:
    parts = [content, *(at(content, path) for path in places(content))]
    mapping = chance.choice([part for part in parts if isinstance(part, dict)])
    name = chance.choice(("memory", "unknown", "method", "status", "", "NN", "mAP@10", "xY", "é"))
    mapping[name] = copy.deepcopy(chance.choice(STRANGE))


def change_list(content: Content, chance: random.Random) -> None:
    lists = [path for path in places(content) if isinstance(at(content, path), list)]
    values = at(content, chance.choice(lists))
    kind = chance.randrange(6)
    if kind == 0 and values:
        values.pop()
    elif kind == 1 and values:
        values.append(copy.deepcopy(values[0]))
    elif kind == 2 and values:
        values[:] = [copy.deepcopy(values[0]) for _ in range(9)]
    elif kind == 3:
        chance.shuffle(values)
    elif kind == 4:
        values.clear()
    else:
        values.append(copy.deepcopy(chance.choice(STRANGE)))


def change_layout(content: Content, chance: random.Random) -> None:
    layouts = [[1, 0], [1, 1], [1, 99], [2, 0], [9, 9], [0, 2], [1], [1, 0, 0], [1, -1], [-1, 0]]
    layouts += [[True, 0], [1.0, 0], "1.0", 1, None, {}, [2**64, 0], [1, 2**64], ["1", "0"]]
    content["layout"] = chance.choice(layouts)
    if chance.random() < 0.5:
        add_field(content, chance)
    if chance.random() < 0.1:
        del content["layout"]


def contradict(content: Content, chance: random.Random) -> None:
    """Make one of the contradictions that were found in merged records, and some alike."""
    kind = chance.randrange(14)
    if kind == 0:
        content["labels"] = content["labels"][:5]
    elif kind == 1:
        content["per_query"] = {}
    elif kind == 2:
        content["per_query"] = {name: [0.5, 0.5] for name in content.get("per_query", {})}
    elif kind == 3:
        content["scores"] = {}
    elif kind == 4:
        content["shapes"] = []
    elif kind == 5:
        content["shapes"] = [content["shapes"][0]] * 9
    elif kind == 6:
        many = chance.choice((50_000, 50_001, 200_000))
        content["shapes"] = [f"s{number}" for number in range(many)]
        content["labels"] = [f"c{number % 100}" for number in range(many)]
        content["per_query"] = {name: [0.5] * many for name in content.get("per_query", {})}
        content["scores"] = dict.fromkeys(content.get("scores", {}), 0.5)
    elif kind == 7:
        content["scores"] = dict.fromkeys(TABLE_MEASURES, 0.9)
    elif kind == 8:
        content["labels"] = [f"alone{number}" for number in range(len(content["labels"]))]
    elif kind == 9:
        content["unsupported"] = [["cat0", "no"], ["nobody", "no"]]
    elif kind == 10:
        content["unprepared"] = ["cat0"]
    elif kind == 11:
        content["per_query"] = {
            name: [None, *values[1:]] for name, values in content.get("per_query", {}).items()
        }
    elif kind == 12:
        content["labels"] = ["cat"] * len(content["labels"])
    else:
        content["status"] = chance.choice(("ok", "failed", "incomplete", "unavailable"))


def recompose(content: Content, chance: random.Random) -> None:
    """Make another record whose fields fit, with strange names: it is to be used."""
    n_classes, n_each = chance.randint(1, 9), chance.randint(2, 5)
    words = [word for word in STRANGE if isinstance(word, str) and word.isprintable() and word]
    names = [chance.choice(words)[:40] for _ in range(n_classes)]
    labels = [name for name in names for _ in range(n_each)]
    shapes = [f"{chance.choice(words)[:40]} {number}" for number in range(len(labels))]
    content |= {"shapes": shapes, "labels": labels, "status": "ok", "gallery_digest": "2"}
    for name in (
        "against",
        "unsupported",
        "unprepared",
        "files",
        "seen",
        "draw_errors",
        "reason",
        "lone_queries",
    ):
        content.pop(name, None)
    values = [round(chance.random(), 6) for _ in labels]
    content["per_query"] = dict.fromkeys(TABLE_MEASURES, values)
    content["scores"] = dict.fromkeys(TABLE_MEASURES, sum(values) / len(values))
    data = chance.choice(("rods", "tosca", "animals-few[noise=1]", *words))[:40]
    content["data"] = {"name": data, "title": chance.choice(words), "source": data}
    if chance.random() < 0.3:
        content["data"]["path"] = chance.choice(words)
    content["gallery"] = data + chance.choice(("", " fold 0", " (quick)", " against 12 cameras"))
    for name in chance.sample(NAMES, 3):
        content[name] = chance.choice(words)


KINDS: tuple[Callable[[Content, random.Random], None], ...] = (
    replace_value,
    remove_value,
    add_field,
    change_list,
    change_layout,
    contradict,
    recompose,
    recompose,
    recompose,
)


def spoil_text(text: bytes, chance: random.Random) -> bytes:
    """Return JSON that is damaged as text."""
    kind = chance.randrange(9)
    place = chance.randrange(len(text))
    spoilt = {
        0: text[:place],
        1: text + b"{}",
        2: b"\xef\xbb\xbf" + text,
        3: text.decode().encode("utf-16"),
        4: text[:place] + b"\xff" + text[place:],
        5: b"[" * 200_000,
        6: b"",
        7: text.replace(b'"status"', b'"key":"%032x","status"' % chance.getrandbits(128), 1),
        8: text.replace(b"0.5", b"1e999", 1).replace(b"0.25", b"NaN", 1),
    }
    return spoilt[kind]


def forge(seed: int, count: int, start: int = 0) -> Iterator[tuple[str, bytes]]:
    """Yield forged records from a number on, with the names of what was done to them."""
    originals = bases()
    for number in range(start, start + count):
        chance = random.Random(f"{seed} {number}")
        content = copy.deepcopy(chance.choice(originals))
        content.pop("checksum", None)
        content["key"] = f"{2**32 + number:032x}"
        done = chance.choices(KINDS, k=chance.choice((1, 1, 1, 2, 3)))
        for kind in done:
            # An earlier change may have taken what this one works on.
            with suppress(KeyError, TypeError, IndexError, AttributeError, ValueError):
                kind(content, chance)
        if isinstance(content.get("method"), str) and chance.random() < 0.7:
            content["method"] = content["method"][:100] + f"-{number}"  # a row of its own
        text = signed(content)
        names = [kind.__name__ for kind in done]
        if chance.random() < 0.08:
            text = spoil_text(text, chance)
            names.append("spoil_text")
        yield " ".join(names), text


def signed(content: Content) -> bytes:
    """Return a content as JSON with its checksum, without the code under test."""
    text = msgspec.json.encode(content, order="sorted")
    # What is read is what JSON holds: of large integers, for example, the nearest number.
    content = msgspec.json.decode(text)
    checksum = digest_of_bytes(msgspec.json.encode(content, order="sorted"))
    return msgspec.json.encode(content | {"checksum": checksum})


# What the verbs do with them
# ------------------------------------------------------------------------------------------------


def key_of(text: bytes) -> str:
    """Return the name of the file of a forgery: its key, if that can be the name of one."""
    try:
        key = msgspec.json.decode(text)["key"]
    except (msgspec.DecodeError, UnicodeError, RecursionError, KeyError, TypeError):
        key = ""
    is_key = isinstance(key, str) and re.fullmatch("[0-9a-f]{32}", key)
    return key if is_key else digest(text.hex())


def expected_means(text: bytes) -> dict[str, float]:
    """Return the means of a record's values per query, by Python's own JSON and sums."""
    means = {}
    for name, values in json.loads(text)["per_query"].items():
        numbers = [value for value in values if value is not None]
        means[name] = math.fsum(numbers) / len(numbers)
    return means


def finding(text: bytes) -> str:
    """Return what is said of a forgery when it is read: why it is skipped, or "used".

    Raises
    ------
    AssertionError
        If it is used, and its scores are not the means of its values.
    """
    try:
        found = parse_record(text)
    except RecordError as error:
        return str(error)
    if found.status == "ok":
        for name, mean in expected_means(text).items():
            assert abs(found.scores[name] - mean) <= 1e-6, name
    assert parse_record(encode_record(found)) == found
    return "used"


class Workshop:
    """Folders in which the verbs meet forgeries."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.data = write_rods(folder / "rods", bends=(0.0, 1.0))
        self.good = folder / "good"
        words = ("-d", self.data, "-m", "surface-area", "--results", self.good)
        call("run", *words, "-j", 0)
        for number, method in enumerate(("gps", "identity", "skeleton")):
            write_record(self.good, record(method, 0.5, key=f"{number:x}" * 32))

    def faults(self, texts: Sequence[bytes]) -> Iterator[str]:
        """Yield what went wrong where verbs met forgeries, but errors with a hint."""
        results, theirs, into = (self.folder / name for name in ("results", "theirs", "into"))
        for place in (results, theirs):
            shutil.rmtree(place, ignore_errors=True)
            (place / "runs" / "records").mkdir(parents=True)
            for text in texts:
                file_of(place, text).write_bytes(text)
        shutil.copytree(self.good, results, dirs_exist_ok=True)
        data = ("-d", self.data, "-m", "surface-area")
        verbs: list[tuple[Any, ...]] = [
            ("tables", "--failed"),
            ("tables", "--format", "latex"),
            ("tables", "--format", "csv"),
            ("tables", "--format", "json", "--failed"),
            ("compare", "gps", "identity"),
            ("compare", "gps"),
            ("plan", *data, "--traceback"),
            ("run", *data, "-j", 0),
            ("forget", "-m", "nothing"),
            ("forget", "--record", file_of(results, texts[0]).stem),
            ("report", "-o", self.folder / "pages", "--force", "--failed"),
        ]
        for words in verbs:
            yield from self._fault_of(*words, "--results", results)
        yield from self._faults_of_figures(results, texts)
        for take in ((), ("--take", "theirs")):
            shutil.rmtree(into, ignore_errors=True)
            shutil.copytree(self.good, into)
            before = contents(into)
            yield from self._fault_of("merge", theirs, *take, "--results", into)
            lost = [name for name, text in before.items() if contents(into).get(name) != text]
            if lost and not take:
                yield f"merge lost {lost}"
        with patch.object(publishing, "has_edits", lambda: False):
            try:
                publishing.publish(results)
            except BenchmarkError:
                pass
            except Exception:
                yield f"publish: {traceback.format_exc()}"
        for text in texts:
            if file_of(results, text).read_bytes() != text:
                yield "a verb rewrote a file"

    @staticmethod
    def _fault_of(*words: Any) -> Iterator[str]:
        """Yield the error that ended a verb, if it has no hint; and files that it did not name."""
        record_files._say_skipped.cache_clear()
        done = CliRunner().invoke(cli, [*map(str, words)])
        has_hint = isinstance(done.exception, BenchmarkError | SystemExit)
        if done.exception is not None and not has_hint:
            lines = traceback.format_exception(done.exception)
            yield f"{words[0]}: {''.join(lines)}"

    @staticmethod
    def _faults_of_figures(results: Path, texts: Sequence[bytes]) -> Iterator[str]:
        """Yield the files that are neither read nor named, and scores that are not those of the
        values.
        """
        skipped = scan_files(local_files(results)).skipped
        named = {skip.where for skip in skipped}
        record_files._say_skipped.cache_clear()
        try:
            with redirect_stderr(io.StringIO()) as said:
                opened = open_results(results)
                frames = [opened.jobs, opened.queries, opened.scores]
        except BenchmarkError:
            return
        except Exception:
            yield f"open_results: {traceback.format_exc()}"
            return
        if missing := [where for where in named if where not in said.getvalue()]:
            yield f"not named: {missing}"
        by_key = {record.key: record for record in opened.records}
        for text in texts:
            path = file_of(results, text)
            if str(path) in named or path.stem not in by_key:
                continue
            used = by_key[path.stem]
            if used.status == "ok" and not used.data.quick and re.search(r"-\d+$", used.method):
                rows = frames[2][frames[2].method == row_of(used)]
                for name, mean in expected_means(text).items():
                    shown = rows[rows.measure == name].value
                    if len(shown) and (shown - mean).abs().min() > 1e-6:
                        yield f"{name} of {used.row} is {[*shown]}, not {mean}"


def file_of(results: Path, text: bytes) -> Path:
    return results / "runs" / "records" / f"{key_of(text)}.json"


def contents(folder: Path) -> dict[str, bytes]:
    """Return the records of a folder by the names of their files."""
    return {path.name: path.read_bytes() for path in (folder / "runs" / "records").glob("*.json")}


def remembering(parse: Callable[[bytes], Record]) -> Callable[[bytes], Record]:
    """Return a parser of records that parses each text once.

    Every verb reads all records of a folder. Parsing, of which most of the time would be spent,
    says the same of a text each time.
    """
    results: dict[bytes, Record | RecordError] = {}

    def parse_once(text: bytes) -> Record:
        if text not in results:
            try:
                results[text] = parse(text)
            except RecordError as error:
                results[text] = error
        result = results[text]
        if isinstance(result, RecordError):
            raise result.with_traceback(None)
        return result

    return parse_once


#: Forgeries that the verbs meet at a time.
BATCH = 250


class Findings(msgspec.Struct):
    """What was said of a batch of forgeries.

    Parameters
    ----------
    said
        How many of them were used, or skipped for which reason.
    faults
        What went wrong with those at fault by their numbers.
    """

    said: dict[str, int]
    faults: dict[int, list[str]]


def examine(workshop: Workshop, seed: int, start: int, count: int) -> Findings:
    """Show every verb a batch of forgeries."""
    texts = {}
    said = Counter[str]()
    faults = {}
    for number, (kinds, text) in enumerate(forge(seed, count, start), start):
        texts[number] = text
        try:
            why = finding(text)
        except Exception:
            why = "FAULT"
            faults[number] = [kinds, traceback.format_exc()]
        said[re.sub(r"['‘].*?['’]|[0-9][0-9.,]*|`.*?`", "*", why)[:110]] += 1
    with patch.object(record_files, "parse_record", remembering(parse_record)):
        faults |= guilty(workshop, texts)
    return Findings({**said}, faults)


def guilty(workshop: Workshop, texts: Mapping[int, bytes]) -> dict[int, list[str]]:
    """Return what goes wrong with which forgeries; with the first, if only with several at once."""
    found = [*workshop.faults([*texts.values()])]
    if not found:
        return {}
    if len(texts) == 1:
        return dict.fromkeys(texts, found)
    numbers = [*texts]
    halves = numbers[: len(numbers) // 2], numbers[len(numbers) // 2 :]
    faults: dict[int, list[str]] = {}
    for half in halves:
        faults |= guilty(workshop, {number: texts[number] for number in half})
    return faults or {numbers[0]: ["together", *found]}


def main(seed: int, count: int, folder: Path) -> int:
    """Show every verb the forgeries; return how many faults were found."""
    workshop = None
    shutil.rmtree(folder / "work", ignore_errors=True)
    said, n_faults = Counter[str](), 0
    for start in range(0, count, BATCH):
        n_batch = min(BATCH, count - start)
        stored = folder / f"{seed}-{start}-{n_batch}.json"
        if not stored.is_file():
            workshop = workshop or Workshop(folder / "work")
            write_text(
                stored, msgspec.json.encode(examine(workshop, seed, start, n_batch)).decode()
            )
        findings = msgspec.json.decode(stored.read_bytes(), type=Findings)
        for number, faults in findings.faults.items():
            [(_, text)] = forge(seed, 1, number)
            (folder / f"fault-{number}.json").write_bytes(text)
            print(number, *faults, sep="\n", flush=True)
        said.update(findings.said)
        n_faults += len(findings.faults)
    for why, times in said.most_common():
        print(f"{times:6} {why}")
    print(f"{count} forged records with seed {seed}: {n_faults} faults")
    return n_faults


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])) > 0)
