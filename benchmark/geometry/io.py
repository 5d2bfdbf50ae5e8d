"""Reading of mesh files, without trust in their content, and writing; every error names the file and gives a hint."""

from __future__ import annotations

import gzip
import io
import re
import warnings
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError, InvalidMesh, UnreadableMesh
from benchmark.files import LARGEST_FILE, check_expansion, named_errors, read_file, write_atomically
from benchmark.geometry.cleaning import merge_duplicates
from benchmark.geometry.gltf import buffer_files, read_gltf
from benchmark.geometry.mesh import FloatArray, IntArray, Mesh, Points
from benchmark.text import counted

Arrays = tuple[Points, IntArray] | tuple[Points, IntArray, IntArray]
"""Vertices, and the corners of triangles, shape (m, 3), or of polygons, one after the other, with their numbers."""

SURFACE = (
    "python -c \"import pymeshlab; m = pymeshlab.MeshSet(); m.load_new_mesh('{name}'); "
    "m.compute_normal_for_point_clouds(); m.generate_surface_reconstruction_screened_poisson(); "
    "m.save_current_mesh('surface.ply')\""
)
"""Command that makes a surface of a point cloud."""

#: Polygons of one size that are split at a time, most corners that are tried, and area of a
#: triangle of a fan that may look the other way, as a share of the polygon: that of a corner on a
#: side, in single precision.
_MOST_POLYGONS, _MOST_CORNERS, _FOLDED = 2**16, 500, 1e-6

_NUMBER = re.compile(
    r"[-+]?((\d+\.?\d*|\.\d+)(e[-+]?\d+)?|nan(\(.*\))?|inf(inity)?)", re.ASCII | re.IGNORECASE
)


def read_mesh(path: Path | str) -> Mesh:
    """Read a triangle mesh; vertices and faces keep the order of the file.

    Parameters
    ----------
    path
        A file with one of the extensions in :data:`READABLE`, also with ``.gz`` behind it. A
        ``.vert`` file lies next to its ``.tri`` file. Polygons are split into triangle fans, each
        around the first corner that sees all others. Exactly coincident corners of an STL file are
        merged.

    Returns
    -------
    Mesh
        The mesh in units of the file, neither cleaned nor scaled.

    Raises
    ------
    UnreadableMesh
        If the file is missing, empty, too large, truncated, not numeric, or in an unknown format.
    InvalidMesh
        If a coordinate is not finite, a vertex index is out of range, or there are no faces.
    """
    path = Path(path)
    suffix = mesh_suffix(path)
    with named_errors(path, f"{suffix[1:]} file", UnreadableMesh, "fetch or export the file again"):
        if suffix == ".tri":
            vertices_beside = re.sub(r"(?i)\.tri(\.gz)?$", ".vert", path.name)
            raise UnreadableMesh(
                "it holds triangles alone", f"name {vertices_beside}, its vertices"
            )
        if suffix not in READABLE:
            raise UnreadableMesh(
                f"unknown extension '{suffix}'", f"convert it to one of {', '.join(READABLE)}"
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of readers, about damaged files
            warnings.filterwarnings(
                "error", "string or file could not be read"
            )  # numpy below 2.3 does not raise
            vertices, corners, *sizes = _READERS[suffix](_load(path), path)
        if not len(corners):
            raise InvalidMesh(
                "there are no faces",
                f"make a surface of the points: {SURFACE.format(name=path.name)}",
            )
        corners = _from_0(corners, len(vertices), 1 if suffix in _FROM_1 else 0)
        return Mesh(vertices, _fans(vertices, corners, *sizes) if sizes else corners)  # type: ignore[arg-type]


def companions(path: Path) -> list[Path]:
    """Return the files beside a mesh file that belong to it: the triangles of a ``.vert`` file, buffers of glTF."""
    if mesh_suffix(path) == ".vert":
        return [_triangles_beside(path)]
    return buffer_files(path) if path.suffix.lower() in (".gltf", ".glb") else []


def _triangles_beside(path: Path) -> Path:
    """Return the ``.tri`` file beside a ``.vert`` file, which may be packed, too."""
    packing = path.suffix if path.suffix.lower() == ".gz" else ""
    plain = path.with_suffix("") if packing else path
    found = [plain.with_suffix(f".tri{end}") for end in (packing, "" if packing else ".gz")]
    return next((file for file in found if file.exists()), found[0])


def mesh_suffix(path: Path) -> str:
    """Return the lower-case extension of a path, that before ``.gz`` if it is packed."""
    return (Path(path.stem) if path.suffix.lower() == ".gz" else path).suffix.lower()


def write_mesh(path: Path | str, mesh: Mesh) -> None:
    """Write a mesh as OFF, OBJ or binary PLY, by extension, with coordinates in full precision.

    On a full disk, the old file remains.

    Raises
    ------
    ConfigurationError
        If the extension is none of ``.off``, ``.obj``, ``.ply``, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".off":
        data = (
            b"OFF\n%d %d 0\n" % (mesh.n_vertices, mesh.n_faces)
            + _rows("", mesh.vertices)
            + _rows("3 ", mesh.faces)
        )
    elif suffix == ".obj":
        data = _rows("v ", mesh.vertices) + _rows("f ", mesh.faces + 1)
    elif suffix == ".ply":
        data = _ply(mesh)
    else:
        raise ConfigurationError(
            f"{path}: cannot write '{suffix}' files", f"choose one of {', '.join(WRITABLE)}"
        )
    try:
        write_atomically(path.resolve(), lambda file: file.write(data))
    except OSError as error:
        problem = f"{path}: {error.strerror}"
        raise ConfigurationError(
            problem, "choose a file in a folder that can be written"
        ) from error


def _rows(prefix: str, table: NDArray[Any]) -> bytes:
    return "".join(f"{prefix}{a!r} {b!r} {c!r}\n" for a, b, c in table.tolist()).encode()


def _ply(mesh: Mesh) -> bytes:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {mesh.n_vertices}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {mesh.n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(mesh.n_faces, dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    return header.encode("ascii") + mesh.vertices.astype("<f8").tobytes() + faces.tobytes()


def _load(path: Path) -> bytes:
    data = read_file(path, LARGEST_FILE)
    if data and path.suffix.lower() == ".gz":
        data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        raise UnreadableMesh(
            f"it holds more than {LARGEST_FILE / 2**30:g} GiB", "decimate the mesh"
        )
    if not data.strip():
        raise UnreadableMesh("the file is empty", "fetch or export the file again")
    return data


def _text(data: bytes) -> bytes:
    """Return text in ASCII, without comments and byte-order marks, with one kind of line break.

    Raises
    ------
    UnreadableMesh
        If it ends within a line of numbers: the last one may be cut off.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16").encode()
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = re.sub(rb"(?<!\S)#[^\n]*", b"\n", text) if b"#" in text else text
    if re.match(rb"\s*[vf\d.+-]", text.rpartition(b"\n")[2]):
        problem = "its last line has no line break, so it may be cut off"
        raise UnreadableMesh(
            problem, "fetch or export it again, or add a line break if it is whole"
        )
    return text


def _lines(text: bytes) -> list[bytes]:
    """Return the lines that are not blank."""
    return [line for line in text.split(b"\n") if line.strip()]


def _parsed(text: bytes) -> FloatArray:
    """Parse numbers; raises ``ValueError`` at anything else (Python itself would take ``1_0`` and other scripts)."""
    try:
        return np.fromstring(text.decode("ascii"), sep=" ") if text.strip() else np.empty(0)
    except (DeprecationWarning, ValueError) as error:
        if re.search(rb"\d,\d", text):
            raise UnreadableMesh(
                "numbers have decimal commas", "export with LC_NUMERIC=C"
            ) from error
        word = next(
            (word for word in text.decode("latin-1").split() if not _NUMBER.fullmatch(word)), ""
        )
        raise ValueError(f"expected a number, not '{word:.20}'") from error


def _is_padding(rest: bytes) -> bool:
    """Return whether what follows the rows of a binary file says nothing."""
    return not rest.strip(b"\0 \t\r\n")


def _table(lines: Sequence[bytes], widths: Collection[int] = (3,)) -> FloatArray:
    """Parse lines of as many numbers, of which the first three are returned; a fourth alone is a weight."""
    found = {len(line.split()) for line in lines}
    if other := found.difference(widths):
        raise ValueError(f"a line has {counted(min(other), 'number')}, not {min(widths)}")
    if (
        4 in found
        and (
            _parsed(b" ".join(row[3] for row in map(bytes.split, lines) if len(row) == 4)) != 1
        ).any()
    ):
        raise ValueError("a line has a fourth number, which is not 1")
    if len(found) > 1:
        lines = [b" ".join(line.split()[:3]) for line in lines]
    return _parsed(b" ".join(lines)).reshape(len(lines), 3 if len(found) != 1 else found.pop())[
        :, :3
    ]


def _integers(numbers: NDArray[np.number]) -> IntArray:
    if not (np.abs(numbers) <= 2**53).all() or (numbers != np.floor(numbers)).any():
        raise ValueError("a vertex index is not a whole number")
    return numbers.astype(np.int64)


def _fans(vertices: Points, corners: IntArray, sizes: IntArray) -> IntArray:
    """Split polygons, one after the other, into fans around the first corner that sees all others."""
    for face in np.flatnonzero(sizes < 3)[:1]:
        raise ValueError(
            f"face {face + 1} of {len(sizes)} has {counted(int(sizes[face]), 'corner')}"
        )
    starts, first = np.cumsum(sizes) - sizes, np.zeros(len(sizes), dtype=np.int64)
    extent = np.abs(vertices).max() or 1.0  # products of coordinates stay in range
    for size in np.unique(sizes[sizes > 3]) if np.isfinite(extent) else ():  # others are no mesh
        same = np.flatnonzero(sizes == size)
        for block in np.array_split(same, len(same) // _MOST_POLYGONS + 1):
            first[block] = _seeing_corners(
                vertices[corners[starts[block, None] + np.arange(size)]] / extent
            )
    for face in np.flatnonzero(first < 0)[:1]:
        problem = (
            f"face {face + 1} of {len(sizes)} is a polygon without a corner that sees all others"
        )
        raise InvalidMesh(problem, "triangulate the polygons before exporting them")
    polygon = np.repeat(np.arange(len(sizes)), sizes - 2)
    within = np.arange(len(polygon)) - np.repeat(starts - 2 * np.arange(len(starts)), sizes - 2)
    turned = [(first[polygon] + step) % sizes[polygon] for step in (0, within + 1, within + 2)]
    return np.stack([corners[starts[polygon] + place] for place in turned], axis=1)


def _seeing_corners(polygons: Points) -> IntArray:
    """Return the first corner of each polygon, shape (p, k, 3), whose fan nowhere folds back; -1 if there is none."""
    first, left = np.full(len(polygons), -1), np.arange(len(polygons))
    for corner in range(min(polygons.shape[1], _MOST_CORNERS)):
        a, *others = np.moveaxis(np.roll(polygons[left], -corner, axis=1), 1, 0)
        sides = np.stack(others) - a
        normals = np.cross(sides[:-1], sides[1:])
        whole = normals.sum(axis=0)
        square = (whole**2).sum(axis=1)
        ahead = ((normals * whole).sum(axis=2) >= -_FOLDED * square).all(axis=0)
        ahead &= square >= _FOLDED * (normals**2).sum(
            axis=(0, 2)
        )  # of sides that cross, halves cancel
        first[left[ahead]], left = corner, left[~ahead]
        if not len(left):
            break
    return first


def _from_0(corners: IntArray, n_vertices: int, base: int) -> IntArray:
    """Return corners counted from 0; raises ``InvalidMesh`` if vertices are missing."""
    low, high, other = int(corners.min()), int(corners.max()), 1 - base
    if other <= low and high < n_vertices + other and (low < base or high >= n_vertices + base):
        hint = f"{'add 1 to' if base else 'subtract 1 from'} each corner"
        raise InvalidMesh(f"this format counts vertices from {base}, the file from {other}", hint)
    if low < base or high >= n_vertices + base:
        missing = (
            f"faces name vertices {low} to {high}, but there are {base} to {n_vertices + base - 1}"
        )
        raise InvalidMesh(missing, "fetch or export the file again")
    return corners - base


def read_off(data: bytes, _: Path) -> Arrays:
    """Read Geomview OFF; a vertex may go on with a normal, a colour or a texture, and a face with a colour."""
    text = _text(data).lstrip()
    header = rb"(?:((?:ST)?C?N?C?)OFF)?\s*(\d{1,12})\s+(\d{1,12})(?:[ \t]+\d+)?[ \t]*\n"
    head = re.match(header, text, re.IGNORECASE)
    if not head:
        raise ValueError("it does not begin with OFF and the numbers of vertices and faces")
    n_vertices, n_faces, body = int(head[2]), int(head[3]), text[head.end() :]
    lines = _lines(body)
    if len(lines) in (1, n_vertices + n_faces) and (
        triangles := _triangle_mesh(body, n_vertices, n_faces)
    ):
        return triangles
    if len(lines) != n_vertices + n_faces:
        raise ValueError(
            f"{n_vertices} vertices and {n_faces} faces announced, but {len(lines)} lines follow"
        )
    width = 3 + 3 * (b"N" in (head[1] or b"").upper()) + 2 * (b"S" in (head[1] or b"").upper())
    return _table(lines[:n_vertices], (width, width + 3, width + 4)), *_counted_polygons(
        lines[n_vertices:]
    )


def _counted_polygons(lines: Sequence[bytes]) -> tuple[IntArray, IntArray]:
    """Parse lines of the number of corners, the corners, and perhaps a colour."""
    rows = [line.split() for line in lines]
    sizes = _integers(_parsed(b" ".join(row[0] for row in rows)))
    for number, (row, size) in enumerate(zip(rows, sizes, strict=True), 1):
        if len(row) <= size:
            raise ValueError(
                f"face {number} of {len(rows)} has {counted(len(row) - 1, 'corner')}, not {size}"
            )
    corners = [word for row, size in zip(rows, sizes, strict=True) for word in row[1 : 1 + size]]
    return _integers(_parsed(b" ".join(corners))), sizes


def _triangle_mesh(body: bytes, n_vertices: int, n_faces: int) -> Arrays | None:
    """Read rows of three for vertices and of four for triangles; None for anything else."""
    try:
        numbers = _parsed(body)
    except ValueError:
        return None
    if len(numbers) != 3 * n_vertices + 4 * n_faces:
        return None
    faces = numbers[3 * n_vertices :].reshape(-1, 4)
    if (faces[:, 0] != 3).any():
        return None
    return numbers[: 3 * n_vertices].reshape(-1, 3), _integers(faces[:, 1:])


def read_obj(data: bytes, _: Path) -> Arrays:
    """Read the vertices and faces of Wavefront OBJ; a negative corner counts back from the latest vertex."""
    text = _text(data).replace(b"\\\n", b" ")
    found = {
        kind: list(re.finditer(rb"(?m)^[ \t]*%s[ \t]+(\S.*)" % kind, text))
        for kind in (b"v", b"fo?")
    }
    vertices, polygons = ([match[1] for match in matches] for matches in found.values())
    if not vertices:
        raise ValueError("there is no line of a vertex, 'v x y z'")
    if other := re.search(rb"(?m)^[ \t]*(?!(?:%s)(?:[ \t]|$))([^ \t\n]+)" % _OBJ_WORDS, text):
        problem = (
            f"it has lines '{other[1].decode('ascii', 'backslashreplace'):.20}', which are not read"
        )
        raise UnreadableMesh(problem, "export one file of triangles")
    sizes = np.array([len(polygon.split()) for polygon in polygons], dtype=np.int64)
    indices = _integers(_parsed(re.sub(rb"/\S*", b"", b" ".join(polygons))))
    of_vertices, of_faces = ([match.start() for match in matches] for matches in found.values())
    latest = np.repeat(
        np.searchsorted(np.array(of_vertices), np.array(of_faces, dtype=np.int64)), sizes
    )
    # One that counts back beyond the first vertex becomes -1.
    corners = np.where(
        indices < 0, np.where(indices + latest < 0, -1, indices + latest + 1), indices
    )
    return _table(vertices, (3, 4, 6, 7)), corners, sizes


def read_vert_tri(data: bytes, path: Path) -> Arrays:
    """Read the ASCII pair of TOSCA, which counts from 1, unless it names vertex 0."""
    companion = _triangles_beside(path)
    vertices = _table(_lines(_text(data)))
    with named_errors(companion, "tri file", UnreadableMesh, "fetch it again"):
        faces = _table(_lines(_text(_load(companion))))
    first, last = int(faces.min()), int(faces.max())
    if first > 0 and last < len(vertices):
        unclear = f"triangles name vertices {first} to {last} of {len(vertices)}, so they may count from 0 or from 1"
        raise ValueError(f"{unclear}; leave out vertices without a triangle")
    return vertices, _integers(faces) - (first > 0)


def read_ply(data: bytes, _: Path) -> Arrays:
    """Read the elements ``vertex`` and ``face`` of PLY."""
    end = next((end for end in (b"\r\n", b"\n", b"\r") if data.startswith(b"ply" + end)), b"\n")
    head, found, body = data.partition(end + b"end_header" + end)
    if not data.startswith(b"ply" + end) or not found:
        raise ValueError("it does not begin with a header between the lines 'ply' and 'end_header'")
    elements, is_text = _elements(head.decode("latin-1").splitlines()[1:])
    names = [name for name, *_ in elements]
    if not {"vertex", "face"} <= {*names} or "tristrips" in names or len(names) > len({*names}):
        raise ValueError(
            f"it has the elements {', '.join(names) or 'none'}, not vertex and face alone"
        )
    lines = _lines(_text(body)) if is_text else []
    body = _parsed(b" ".join(lines)).tobytes() if is_text else body
    at, runs = 0, dict[str, list[NDArray[Any]]]()
    for name, count, fields in elements:
        runs[name] = _ply_rows(body, at, name, count, fields)
        at += sum(run.nbytes for run in runs[name])
    if not _is_padding(body[at:]):
        raise ValueError(f"{len(body) - at} bytes follow the rows that its header announces")
    widths = np.concatenate(
        [np.full(len(run), run.itemsize // 8) for name in names for run in runs[name]]
    )
    if is_text and widths.tolist() != [len(line.split()) for line in lines]:
        raise ValueError("its lines are not the rows that its header announces")
    vertices = np.concatenate(
        [np.stack([run[axis] for axis in "xyz"], axis=1) for run in runs["vertex"]]
    )
    corners = (
        "vertex_index"
        if "vertex_index" in (runs["face"][0].dtype.names or ())
        else "vertex_indices"
    )
    sizes = np.concatenate([np.full(len(run), run[corners].shape[1]) for run in runs["face"]])
    flat = np.concatenate([run[corners].ravel() for run in runs["face"]])
    return vertices.astype(np.float64), _integers(flat), sizes


def _elements(lines: Sequence[str]) -> tuple[list[tuple[str, int, list[Any]]], bool]:
    """Return names, numbers of rows and fields of the elements of a header of PLY, and whether numbers are text."""
    elements, orders = list[tuple[str, int, list[Any]]](), list[str]()

    def kind_of(name: str) -> str:
        return "<f8" if orders == ["ascii"] else orders[-1] + _PLY_TYPES[name]

    for line in lines:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", order, "1.0"] if not orders and order in _PLY_ORDERS:
                orders.append(_PLY_ORDERS[order])
            case ["element", name, count] if orders and re.fullmatch("[0-9]{1,18}", count):
                elements.append((name, int(count), []))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1][2].append((name, kind_of(kind), ""))
            case ["property", "list", size, kind, name] if (
                elements and {size, kind} <= _PLY_TYPES.keys()
            ):
                elements[-1][2].append((name, kind_of(kind), kind_of(size)))
            case _:
                raise ValueError(f"the line '{line:.80}' of its header is not read")
    return elements, orders == ["ascii"]


def _ply_rows(
    data: bytes, at: int, element: str, count: int, fields: Sequence[Any]
) -> list[NDArray[Any]]:
    """Return rows of an element, in runs whose lists are of the same lengths; that of an element without rows is empty.

    A field is its name, its type, and the type of the length of a list or "".
    """
    runs, most = list[NDArray[Any]](), count
    while count or not runs:
        layout, lengths = list[Any](), dict[str, int]()
        for name, kind, size in fields:
            if size:
                layout.append((f"{name} size", size))
                length = (
                    np.frombuffer(data, layout, 1, at)[f"{name} size"]
                    if count and at < len(data)
                    else np.zeros(1)
                )
                lengths[f"{name} size"] = int(_integers(length)[0])
            layout.append((name, kind, (lengths[f"{name} size"],)) if size else (name, kind))
        row = np.dtype(layout)
        fitting = min(count, most, (len(data) - at) // max(row.itemsize, 1))
        if count and not (fitting and row.itemsize):
            raise ValueError(f"{count} rows of {element} announced, but it ends before them")
        run = np.frombuffer(data, row, fitting, at) if fitting else np.empty(0, row)
        differs = np.zeros(len(run), dtype=bool)
        for name, number in lengths.items():
            differs |= run[name] != number
        run = run[: differs.argmax()] if differs.any() else run
        runs.append(run)
        at, count, most = at + run.nbytes, count - len(run), 1 if differs.any() else 2 * most
    return runs


def read_mat(data: bytes, _: Path) -> Arrays:
    """Read the MATLAB struct ``surface`` of TOSCA: X, Y, Z and the triangles TRIV, which count from 1."""
    from scipy.io import loadmat

    check_expansion(data)
    try:
        content = loadmat(io.BytesIO(data), variable_names=["surface"])
    except NotImplementedError as error:
        raise ValueError("it is a MATLAB 7.3 file; save it with '-v7'") from error
    surface = content.get("surface", np.empty(0))
    if surface.size != 1 or not {"X", "Y", "Z", "TRIV"} <= set(surface.dtype.names or ()):
        raise ValueError("it has no struct 'surface' with X, Y, Z and TRIV")
    fields = {name: np.asarray(surface.flat[0][name]) for name in ("X", "Y", "Z", "TRIV")}
    if any(field.dtype.kind not in "iuf" for field in fields.values()) or fields["TRIV"].shape[
        1:
    ] != (3,):
        raise ValueError("X, Y and Z are no real numbers, or TRIV has not three columns")
    if len({fields[axis].size for axis in "XYZ"}) > 1:
        raise ValueError("X, Y and Z differ in length")
    vertices = np.stack([fields[axis].ravel(order="F") for axis in "XYZ"], axis=1).astype(
        np.float64
    )
    return vertices, _integers(fields["TRIV"].astype(np.float64))


def read_stl(data: bytes, _: Path) -> Arrays:
    """Read ASCII or binary STL; corners at exactly the same position become a single vertex."""
    size = 84 + 50 * int.from_bytes(data[80:84], "little")
    if 84 < size <= len(data) and _is_padding(data[size:]):
        facets = np.frombuffer(
            data[84:size], [("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")]
        )
        corners = facets["corners"].astype(np.float64)
    elif data.lstrip()[:5].lower() != b"solid":
        raise ValueError(
            f"{len(data)} bytes are neither an ASCII STL nor as many triangles as it announces"
        )
    elif b"endsolid" not in data[-200:].lower():
        raise ValueError("it does not end with 'endsolid'")
    else:
        corners = _stl_facets(_text(data).partition(b"\n")[2].lower())
    distinct, place = merge_duplicates(corners.reshape(-1, 3))
    return distinct, place.reshape(-1, 3)


def _stl_facets(text: bytes) -> FloatArray:
    found = re.findall(rb"(?m)^[ \t]*(?:vertex[ \t]+(\S+[ \t]+\S+[ \t]+\S+)[ \t]*$|endfacet)", text)
    ends = np.flatnonzero([not numbers for numbers in found])
    for facet in np.flatnonzero(np.diff(ends, prepend=-1) != 4)[:1]:
        n_vertices = int(np.diff(ends, prepend=-1)[facet]) - 1
        raise ValueError(
            f"facet {facet + 1} of {len(ends)} has {counted(n_vertices, 'vertex', 'vertices')}"
        )
    return _parsed(b" ".join(found))


_READERS: dict[str, Callable[[bytes, Path], Arrays]] = {
    ".off": read_off,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".mat": read_mat,
    ".vert": read_vert_tri,
    ".glb": read_gltf,
    ".gltf": read_gltf,
}
_PLY_ORDERS = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}
_PLY_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
    **{
        f"{name}{8 * size}": f"{name[0]}{size}" for name in ("int", "uint") for size in (1, 2, 4, 8)
    },
}
#: First words of the lines of an OBJ file, but for splines (``curv``, ``surf``) and other files
#: (``call``).
_OBJ_WORDS = rb"v[tnp]?|fo?|[lpgos]|mg|mtllib|usemtl|usemap|maplib|bevel|[cd]_interp|lod|shadow_obj|trace_obj"
_FROM_1 = (".obj", ".mat")
READABLE: tuple[str, ...] = tuple(_READERS)
WRITABLE: tuple[str, ...] = (".off", ".obj", ".ply")
