"""Generated human bodies: subjects as phenotypes, poses as joint angles, and the meshes of both.

The parametric body is that of the package ``anny`` [Brégier et al. 2025; its assets stem from
MakeHuman and are CC0]: blend shapes for the body, linear blend skinning for the pose. The result is
deterministic. Subjects and poses are in ``subjects.csv`` and ``poses.csv``.

The angles of a pose follow the conventions of physiotherapy, in degrees. ``raised`` is the angle
between the upper arm and straight down, ``forward`` its direction seen from above (90 is to the
front), ``roll`` turns about a limb, ``bend`` of elbow and knee is 0 if they are straight,
``flexion`` moves the thigh to the front and ``abduction`` to the outside, ``point`` lowers the
toes. Trunk, head and body ``bend`` to the front, ``lean`` and ``turn`` to the body's left.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import sys
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmark.errors import DatasetError
from benchmark.geometry.cleaning import connected_components
from benchmark.geometry.mesh import Faces, FloatArray, IntArray, Mesh

#: Directions of the left limbs of the model at rest: x to the body's left, -y to the front, z up.
#: They differ by less than three degrees between subjects; with a constant, a pose has the same
#: rotations for all subjects.
_UPPER_ARM = np.array([0.664, -0.021, -0.747])
_FOREARM = np.array([0.512, -0.687, -0.517])
_SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
_NECK = ("neck01", "neck02", "neck03", "head")
#: Fraction of the swing of an arm that the shoulder girdle takes.
_CLAVICLE_SHARE = 0.2

#: Fraction of the hip flexion that the second bone of the thigh takes.
_THIGH_SHARE = 0.15

#: Number of angles of an arm.
_ARM = 4

#: Number of angles of a leg.
_LEG = 5

#: Number of angles of a part of the trunk.
_COLUMN = 3

#: Runs of vertices of the template in mouth, nostrils and eye sockets; commit 26c8d472 has the code
#: that made it.
CAVITIES = Path(__file__).parent / "cavities.csv"

#: Decimals of coordinates in metres.
_DECIMALS = 6


@dataclass(frozen=True)
class Subject:
    """A body; all values are in [0, 1].

    Parameters
    ----------
    gender
        0 is male, 1 is female.
    age
        1/3 is a child, 2/3 a young adult, 1 old.
    muscle, weight, height
        0.5 is the average for the age and gender.
    proportions
        0 is uncommon, 1 ideal.
    """

    gender: float
    age: float
    muscle: float
    weight: float
    height: float
    proportions: float


def _table(file: str) -> list[dict[str, str]]:
    """Return the rows of a table beside this module, by the titles of its columns."""
    with (Path(__file__).parent / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def _subjects() -> dict[str, dict[str, Subject]]:
    """Return the subjects of the table by data set and name."""
    sets: dict[str, dict[str, Subject]] = {}
    for row in _table("subjects.csv"):
        body = Subject(*(float(row[field.name]) for field in fields(Subject)))
        sets.setdefault(row["set"], {})[row["subject"]] = body
    return sets


def _poses() -> dict[str, FloatArray]:
    """Return the joint angles of the poses of the table by name."""
    poses = {}
    for row in _table("poses.csv"):
        name = row.pop("pose")
        poses[name] = np.array([float(angle) for angle in row.values()])
    return poses


#: Joint angles of each pose, shape (27,); the first pose is the canonical one.
POSES: Mapping[str, FloatArray] = _poses()

#: Subjects by data set and name.
SUBJECTS: Mapping[str, Mapping[str, Subject]] = _subjects()


def describe_body(subject: Subject, angles: FloatArray) -> str:
    """Return the phenotype and joint angles that determine a mesh."""
    body = np.round(astuple(subject), 9).tolist()
    joints = np.round(angles, 9).tolist()
    return f"body {body} with joints {joints}"


def mirrored_pose(angles: FloatArray) -> FloatArray:
    """Return a pose with left and right exchanged."""
    left_arm, right_arm, left_leg, right_leg, columns = np.split(
        angles, np.cumsum([_ARM, _ARM, _LEG, _LEG])
    )
    return np.concatenate(
        [right_arm, left_arm, right_leg, left_leg, columns * np.tile([1.0, -1.0, -1.0], 3)]
    )


def jittered(angles: FloatArray, deviation: float, random: np.random.Generator) -> FloatArray:
    """Return a pose with every angle perturbed, within its range over all poses.

    Parameters
    ----------
    angles
        Joint angles, shape (27,).
    deviation
        Standard deviation in degrees.
    random
        Random generator.
    """
    poses = np.stack([*POSES.values(), *map(mirrored_pose, POSES.values())])
    perturbed = angles + random.normal(0.0, deviation, angles.shape)
    return np.clip(perturbed, poses.min(axis=0), poses.max(axis=0))


def named_random(name: str, purpose: str) -> np.random.Generator:
    """Return the generator for a random part of a scanned shape or subject."""
    digest = hashlib.sha256(f"humans-scanlike|{name}|{purpose}".encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def bone_rotations(angles: FloatArray) -> dict[str, FloatArray]:
    """Return the rotation of each bone of a body in a pose, relative to its parent bone.

    Parameters
    ----------
    angles
        Joint angles in degrees, shape (27,): 4 of each arm, 5 of each leg, and 3 each of the trunk,
        the head and the body as a whole.

    Returns
    -------
    dict of str to numpy.ndarray
        Rotation matrices about the axes of the body at rest, shape (3, 3), by the name of the bone
        in the MakeHuman rig. Bones that are not named stay at rest.
    """
    left_arm, right_arm, left_leg, right_leg, trunk, head, body = np.split(
        angles, np.cumsum([_ARM, _ARM, _LEG, _LEG, _COLUMN, _COLUMN])
    )
    rotations = {"root": _column(body, 1)}
    rotations |= dict.fromkeys(_SPINE, _column(trunk, len(_SPINE)))
    rotations |= dict.fromkeys(_NECK, _column(head, len(_NECK)))
    for bone, rotation in (_arm(*left_arm) | _leg(*left_leg)).items():
        rotations[f"{bone}.L"] = rotation
    # The mirror image of a rotation across the plane x = 0 turns the other way about y and z.
    for bone, rotation in (_arm(*right_arm) | _leg(*right_leg)).items():
        rotations[f"{bone}.R"] = Rotation.from_rotvec(rotation.as_rotvec() * [1.0, -1.0, -1.0])
    return {bone: rotation.as_matrix() for bone, rotation in rotations.items()}


def _column(angles: FloatArray, bones: int) -> Rotation:
    """Return the rotation of each of some bones that share the angles of a part of the trunk."""
    bend, lean, turn = angles / bones
    return Rotation.from_euler("ZXY", [turn, bend, lean], degrees=True)


def _arm(raised: float, forward: float, roll: float, bend: float) -> dict[str, Rotation]:
    """Return the rotation of each bone of the left arm, by its name.

    The upper arm first rolls about its own axis, then swings to its direction by the shortest
    rotation. The x axis points to the left of the body, y to its back, and z up.

    Parameters
    ----------
    raised
        Angle between the upper arm and straight down, in degrees.
    forward
        Angle by which the raised arm points forward instead of sideways, in degrees.
    roll
        Turn of the upper arm about its axis, in degrees; clockwise as seen from the elbow.
    bend
        Bend of the elbow, in degrees; 0 is a straight arm.
    """
    # The direction of the upper arm in spherical coordinates; angles are in radians from here on.
    raised = np.radians(raised)
    forward = np.radians(forward)
    side = np.sin(raised) * np.cos(forward)
    front = np.sin(raised) * np.sin(forward)
    direction = np.array([side, -front, -np.cos(raised)])
    # The shortest rotation from the direction at rest: its axis times its angle.
    axis = np.cross(_UPPER_ARM, direction)
    angle = np.arctan2(np.linalg.norm(axis), _UPPER_ARM @ direction)
    swing = axis * (angle / max(float(np.linalg.norm(axis)), 1e-12))
    # Each of the two bones of the upper arm takes half of the roll, so that the skin twists along
    # the whole upper arm and not at the shoulder alone.
    half_roll = Rotation.from_rotvec(-np.radians(roll) / 2 * _UPPER_ARM)
    # The elbow turns about the normal of the plane of upper arm and forearm. The arm of the model
    # is bent already at rest.
    hinge = np.cross(_UPPER_ARM, _FOREARM)
    bend_at_rest = np.arctan2(np.linalg.norm(hinge), _UPPER_ARM @ _FOREARM)
    hinge /= np.linalg.norm(hinge)
    return {
        "clavicle": Rotation.from_rotvec(_CLAVICLE_SHARE * swing),
        "upperarm01": Rotation.from_rotvec((1 - _CLAVICLE_SHARE) * swing) * half_roll,
        "upperarm02": half_roll,
        "lowerarm01": Rotation.from_rotvec((np.radians(bend) - bend_at_rest) * hinge),
    }


def _leg(
    flexion: float, abduction: float, roll: float, bend: float, point: float
) -> dict[str, Rotation]:
    """Return the rotation of each bone of the left leg, by its name.

    The x axis points to the left of the body, y to its back, and z up. All angles are in degrees.

    Parameters
    ----------
    flexion
        How far the thigh is raised forward.
    abduction
        How far it is raised sideways.
    roll
        How far it is turned about its axis.
    bend
        Bend of the knee.
    point
        Stretch of the foot.
    """

    def about_x(angle: float) -> Rotation:
        """Return a rotation in the plane of walking, in degrees."""
        return Rotation.from_euler("x", angle, degrees=True)

    # The two bones of the thigh share the roll equally, and the flexion by a constant.
    half_roll = Rotation.from_euler("z", roll / 2, degrees=True)
    outwards = Rotation.from_euler("y", -abduction, degrees=True)
    return {
        "upperleg01": about_x(-(1 - _THIGH_SHARE) * flexion) * outwards * half_roll,
        "upperleg02": about_x(-_THIGH_SHARE * flexion) * half_roll,
        "lowerleg01": about_x(bend),
        "foot": about_x(point),
    }


def body_mesh(subject: Subject, angles: FloatArray) -> Mesh:
    """Generate the mesh of a body in a pose.

    Parameters
    ----------
    subject
        Age, weight and other features of the body.
    angles
        Joint angles, shape (27,); see :func:`bone_rotations`.

    Returns
    -------
    Mesh
        A closed mesh of genus 0 with 13 348 vertices and 26 692 triangles, which are the same for
        all bodies. Coordinates are in metres, z up; the body faces -y, with its left hand towards
        +x.

    Raises
    ------
    DatasetError
        If the packages for generating bodies are missing.
    """
    template = _template()
    import torch  # lazy

    # The model takes tensors with one row for each body.
    transforms = {}
    for bone, rotation in bone_rotations(angles).items():
        transforms[bone] = torch.eye(4, dtype=torch.float64)[None]
        transforms[bone][0, :3, :3] = torch.from_numpy(rotation)
    phenotypes = {
        name: torch.tensor([value], dtype=torch.float64) for name, value in asdict(subject).items()
    }
    # Sums in one thread are the same on all machines.
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            result = template.model(pose_parameters=transforms, phenotype_kwargs=phenotypes)
    finally:
        torch.set_num_threads(threads)
    vertices = np.asarray(result["vertices"][0].numpy(), dtype=np.float64)
    return Mesh(np.round(vertices[template.kept], _DECIMALS), template.faces)


def vertices_of(bones: tuple[str, ...], side: str = "") -> IntArray:
    """Return the indices of vertices dominated by the given bones.

    Parameters
    ----------
    bones
        Prefixes of bone names, e.g. ``("wrist", "finger")``.
    side
        Suffix of bone names: ``".L"``, ``".R"``, or empty for any.
    """
    return np.flatnonzero(
        [bone.startswith(bones) and bone.endswith(side) for bone in _template().bones]
    )


@functools.cache
def reference_mesh() -> Mesh:
    """Return the template of all bodies at rest.

    Every generated mesh has the same triangles and vertex order.
    """
    template = _template()
    return Mesh(template.model.template_vertices.numpy()[template.kept], template.faces)


@dataclass(frozen=True)
class _Template:
    """The parametric body, without eyes and tongue.

    Parameters
    ----------
    model
        The model of the package ``anny``.
    kept
        Mask of those vertices of the model that a mesh has.
    faces
        Triangles of a mesh.
    bones
        The bone with the largest weight at each vertex of a mesh.
    """

    model: Any
    kept: NDArray[np.bool_]
    faces: Faces
    bones: tuple[str, ...]


@functools.cache
def _template() -> _Template:
    """Return the parametric body; raise ``DatasetError`` if its packages are missing."""
    try:
        model = _model()
    except ImportError as error:
        package = (error.name or "anny").partition(".")[0]
        problem = f"generated people need the package '{package}'"
        raise DatasetError(problem, f"run `pip install {package}`") from error
    is_skin, faces = _skin(model)
    return _Template(model, is_skin, faces, _strongest_bones(model, np.flatnonzero(is_skin)))


def _skin(model: Any) -> tuple[NDArray[np.bool_], Faces]:
    """Return which vertices of a model are its skin, and the triangles between them, renumbered.

    Eyes and tongue are left out: they are smaller components inside the head.
    """
    faces = model.get_triangular_faces().numpy().astype(np.int32)
    components = connected_components(Mesh(model.template_vertices.numpy(), faces))
    largest = np.bincount(components).argmax()
    is_skin = components == largest
    new_numbers = np.cumsum(is_skin, dtype=np.int32) - 1
    faces_of_skin = faces[is_skin[faces[:, 0]]]
    return is_skin, new_numbers[faces_of_skin]


def _strongest_bones(model: Any, vertices: IntArray) -> tuple[str, ...]:
    """Return the name of the bone that moves each of some vertices of a model most."""
    strongest = model.vertex_bone_weights.numpy()[vertices].argmax(axis=1)
    bones = model.vertex_bone_indices.numpy()[vertices, strongest]
    return tuple(model.bone_labels[bone] for bone in bones)


def _model() -> Any:
    """Return the body model of the package ``anny``, with bytes that are equal on all machines.

    The package sums up the weighted movements of bones in an order that depends on the machine; the
    model that is returned sums them in one order.
    """
    import anny
    import anny.paths
    import torch

    if not any(anny.paths.get_anny_cache_path().glob("*/*")):
        hint = "anny builds its cache on first use; this takes about half a minute"
        sys.stderr.write(f"{hint}\n")

    class Body(anny.Anny):  # type: ignore[misc]
        """Model whose linear blend skinning adds in one order and in double precision."""

        def get_skinned_vertices(self, rest_vertices: Any, bone_transforms: Any) -> Any:
            """Return the posed vertices: the mean of where their bones move them, by weight.

            Parameters
            ----------
            rest_vertices
                Shape (bodies, n, 3).
            bone_transforms
                Shape (bodies, bones, 4, 4).
            """
            posed = _skinned(
                rest_vertices.numpy(),
                bone_transforms.numpy(),
                self.vertex_bone_indices.numpy(),
                self.vertex_bone_weights.numpy(),
            )
            return torch.from_numpy(posed)

    return Body(skinning_method="lbs", pose_parameterization="local-ref")


def _skinned(
    rest: FloatArray, transforms: FloatArray, bones: IntArray, weights: FloatArray
) -> FloatArray:
    """Pose vertices by linear blend skinning: the mean of where their bones move them, by weight.

    Sums are taken in one order, so that results are the same on all machines.

    Parameters
    ----------
    rest
        Vertices of the bodies at rest, shape (bodies, n, 3).
    transforms
        Affine transform of each bone, shape (bodies, bones, 4, 4).
    bones
        The few bones that each vertex follows, shape (n, slots).
    weights
        Weight of each of them, shape (n, slots).

    Returns
    -------
    numpy.ndarray
        The posed vertices, shape (bodies, n, 3).
    """
    posed = np.zeros(rest.shape)
    x = rest[..., 0, None]
    y = rest[..., 1, None]
    z = rest[..., 2, None]
    for slot in range(bones.shape[1]):
        affine = transforms[:, bones[:, slot], :3]
        moved = affine[..., 0] * x + affine[..., 1] * y + affine[..., 2] * z + affine[..., 3]
        posed += weights[:, slot, None] * moved
    return posed
