"""Damage files of users by structure: cut them, change counts, numbers, bytes. Each must be refused
or read alike.

``python -m tests.fuzz SEED COUNT FOLDER`` damages so many files, and writes those that are read
otherwise, or hang, into a folder. Correct the cause, and move the file to the bad inputs of its
kind."""

from __future__ import annotations

import re
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import benchmark
from benchmark.commands.distance_files import as_distances
from benchmark.datasets.folder import read_cla
from benchmark.datasets.mesh_files import read_mesh, write_mesh
from benchmark.depth.intrinsics import read_intrinsics
from benchmark.depth.reading import read_mask, read_values
from benchmark.errors import BenchmarkError
from tests.toy import rod

#: Longest time in seconds and most memory in bytes for a file.
LONGEST, MOST = 10, 2**30

#: What no exporter writes where a number should stand, or is none.
NO_NUMBERS = (
    b"1_0",
    b"0x1A",
    b"--1",
    b"1.2.3",
    b"1.#IND",
    b"-1.#QNAN00",
    b"\xd9\xa3",
    b"1e999",
    b"nan",
)
COUNTS = (b"-1", b"0", b"1", b"7", b"99", b"1099511627776", b"9" * 400, b"1e3")
NUMBER = re.compile(rb"(?<![^\s:\[,;])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?![^\s\],;}])")

Random = np.random.Generator
Damage = Callable[[bytes, Random], bytes]


def cut(data: bytes, random: Random) -> bytes:
    return data[: random.integers(len(data.rstrip()))]


def cut_above(data: bytes, random: Random) -> bytes:
    """Cut before the last number; within it, nobody can tell a cut from a text without a last line
    break.
    """
    words = [*re.finditer(rb"\S+", data)]
    return data[: random.integers(max(1, words[-1].start()))]


def flip(data: bytes, random: Random) -> bytes:
    at = int(random.integers(len(data)))
    return data[:at] + bytes([data[at] ^ 1 << int(random.integers(8))]) + data[at + 1 :]


def spoil(data: bytes, random: Random) -> bytes:
    return replaced(data, random, NO_NUMBERS, [*NUMBER.finditer(data)])


def miscount(data: bytes, random: Random) -> bytes:
    """Change one of the first numbers, which are counts."""
    return replaced(data, random, COUNTS, [*NUMBER.finditer(data)][:2])


def replaced(
    data: bytes, random: Random, others: Sequence[bytes], found: Sequence[re.Match[bytes]]
) -> bytes:
    if not found:  # of numbers that have other marks around them
        return b""
    chosen = found[random.integers(len(found))]
    return data[: chosen.start()] + others[random.integers(len(others))] + data[chosen.end() :]


def read(path: Path) -> tuple[Any, ...]:
    """Return what is read from a file, by its extension."""
    if path.parent.name == "cameras":
        return (read_intrinsics(path),)
    if path.suffix == ".cla":
        return (read_cla(path),)
    if path.parent.name == "matrices":
        benchmark.score(path, list("aabbb"))
        return (np.triu(as_distances(path)[0], 1),)
    if path.parent.name == "images":
        return (read_mask(path) if "mask" in path.name else read_values(path),)
    mesh = read_mesh(path)
    return mesh.vertices, mesh.faces


TEXT: tuple[Damage, ...] = (cut_above, spoil, miscount)
#: What may happen to a kind of file and is not another valid file.
DAMAGES: dict[str, tuple[Damage, ...]] = {
    **dict.fromkeys((".off", ".ply", ".cla"), TEXT),
    **dict.fromkeys((".obj", ".vert"), (spoil,)),
    **dict.fromkeys((".gz", ".png", ".npz"), (cut, flip)),
    **dict.fromkeys((".glb", ".mat", ".npy", ".tiff", ".stl"), (cut,)),
    **dict.fromkeys((".pfm", ".pgm"), (cut, miscount)),
    **dict.fromkeys((".gltf", ".csv", ""), (spoil,)),
}


def originals(folder: Path) -> list[Path]:
    """Return whole files of all kinds, some of them written into a folder."""
    here = Path(__file__).parent
    for name in ("matrices", "images"):
        (folder / name).mkdir()
    for suffix in (".off", ".obj", ".ply"):
        write_mesh(folder / f"rod{suffix}", rod(0.1, 1.0))
    mask = np.zeros((40, 60), dtype=np.uint8)
    mask[10:30, 10:30] = 255
    Image.fromarray(mask).save(folder / "images" / "mask.png")
    (folder / "x.cla").write_text("PSB 1\n2 4\n\nman 0 2\n0\n1\n\nwoman 0 2\n2\n3\n")
    distances = np.add.outer(np.arange(5), np.arange(5)) / 7 + 1.0
    np.save(folder / "matrices" / "x.npy", distances)
    np.savetxt(folder / "matrices" / "x.csv", distances, delimiter=",")
    inputs = [
        *(here / "geometry" / "inputs" / "valid").iterdir(),
        *(here / "depth" / "inputs" / "images").iterdir(),
    ]
    inputs += [*(here / "depth" / "inputs" / "cameras").iterdir(), *folder.rglob("*.*")]
    return sorted(path for path in inputs if path.suffix in DAMAGES and ".tri" not in path.name)


def same(one: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    return all(
        np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
        for a, b in zip(one, other, strict=True)
    )


def late(*_: object) -> None:
    raise KeyboardInterrupt


def verdict(path: Path, expected: tuple[Any, ...]) -> str:
    """Return what became of a damaged file: ``refused``, ``alike``, or what is wrong."""
    signal.alarm(LONGEST)
    try:
        return "alike" if same(read(path), expected) else "other content"
    except BenchmarkError as error:
        is_named = (
            path.name in str(error) or path.parent.name == "matrices"
        )  # which is the only one
        return "refused" if is_named and "\n" not in str(error) else f"without a name: {error}"
    except KeyboardInterrupt:
        return "hangs"
    except BaseException as error:
        return f"raises {error!r}"
    finally:
        signal.alarm(0)


def fuzz(seed: int, n_files: int, found: Path) -> Counter[str]:
    """Damage so many files; write those that are wrong into a folder, and count all by what became
    of them.
    """
    random, counts = np.random.default_rng(seed), Counter[str]()
    signal.signal(signal.SIGALRM, late)
    with tempfile.TemporaryDirectory() as name:
        whole = originals(Path(name))
        contents = {path: (path.read_bytes(), read(path)) for path in whole}
        kinds = cycle([[path for path in whole if path.suffix == kind] for kind in DAMAGES])
        for files in islice(kinds, n_files):
            original = files[random.integers(len(files))]
            data, expected = contents[original]
            damage = DAMAGES[original.suffix][random.integers(len(DAMAGES[original.suffix]))]
            path = Path(name) / "damaged" / original.parent.name / original.name
            path.parent.mkdir(parents=True, exist_ok=True)
            for beside in original.parent.glob(f"{original.name.partition('.')[0]}.tri*"):
                (path.parent / beside.name).write_bytes(beside.read_bytes())
            path.write_bytes(damage(data, random))
            result = verdict(path, expected)
            counts[f"{original.suffix} {result}"] += 1
            if result not in ("refused", "alike"):
                found.mkdir(parents=True, exist_ok=True)
                kept = found / f"{seed}-{sum(counts.values())}-{damage.__name__}-{original.name}"
                kept.write_bytes(path.read_bytes())
                print(f"{kept}: {result}")
    return counts


if __name__ == "__main__":
    numbers = fuzz(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
    print(*(f"{count:6d} {what}" for what, count in sorted(numbers.items())), sep="\n")
    # The greatest memory of a process that getrusage returns is that of the one that began it, if
    # this is greater.
    memory = 1024 * int(re.findall(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())[0])
    print(f"largest memory: {memory / 1e6:.0f} MB")
    is_wrong = any(not what.endswith((" refused", " alike")) for what in numbers) or memory > MOST
    sys.exit(is_wrong)
