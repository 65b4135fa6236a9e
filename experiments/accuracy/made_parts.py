"""Pairs of parts with ground truth, made of whole shapes of the sets for fitting.

What a camera sees of a shape, beside the whole of another one or what a camera sees of
that; and pieces of both that a plane or a geodesic ball cuts off. Sizes differ by some
12 %, and Y is turned at random.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.accuracy import cuts, datasets, protocol
from jfsf.data import Sample
from jfsf.mesh import largest_component, surface_area
from jfsf.mesh._edit import Submesh
from jfsf.refine._rest import closest_rotations
from jfsf.types import Mesh

# Pairs of each kind that are made of pairs of a set.
NUMBERS = {
    "faust_r": {"view_whole": 6, "view_view": 6, "cuts": 4},
    "tosca_iso_r": {"view_whole": 4, "view_view": 4, "cuts": 4},
    "becos_ff": {"view_whole": 4, "view_view": 4, "cuts": 4},
}
PIXELS, POINTS = 220, 300_000  # of the picture; of the surface, that are drawn in it
BEHIND = 0.02  # of the picture's width, by which what is seen may lie behind a pixel
FACING = 0.08  # least cosine between a normal and the direction of the camera
SPREAD = 0.35  # of the directions of two cameras
KEEP = 0.35, 0.8  # share of the area that a cut leaves
SIZE = 0.12  # standard deviation of the logarithm of the size
# Least shares of the ground truth of each part that the other has, and of one of them.
SHARED, SHARED_BY_ONE = (0.35, 0.25), 0.45
MIN_VERTICES, MIN_POINTS = 600, 30
TRIES = 40
TRUTH = 1200  # points of ground truth, at most


class Made(NamedTuple):
    """name: of the set, of the kind, of both shapes, and a number."""

    name: str
    x: datasets.Shape
    y: datasets.Shape


def pairs(root: Path, seed: int = 0) -> Iterator[Made]:
    """All of them, those of a set after those of another."""
    for i, (name, numbers) in enumerate(NUMBERS.items()):
        data_set = protocol.below(protocol.SETS[name], root)
        known = datasets.pairs_of(data_set)
        for j, (kind, number) in enumerate(numbers.items()):
            rng = np.random.default_rng((seed, i, j))
            order = rng.permutation(len(known))
            for n in range(number):
                pair = known[order[n % len(order)]]
                both = datasets.load_pair_of(data_set, pair)
                made = _parts(*both, kind, rng)
                if made is not None:
                    yield Made(f"{name} {kind} {pair.x} {pair.y} {n}", *made)


def _parts(x, y, kind: str, rng) -> tuple[datasets.Shape, datasets.Shape] | None:
    """Parts that share enough, or None if that many tries make none."""
    some = rng.permutation(len(x.truth))[: 2 * TRUTH]
    samples = [Sample(shape.mesh, np.asarray(shape.truth)[some]) for shape in (x, y)]
    for _ in range(TRIES):
        parts = KINDS[kind](*samples, rng)
        at = [_place(own, part) for own, part in zip(samples, parts, strict=True)]
        both = np.logical_and(*(own >= 0 for own in at))
        shares = [both.sum() / max((own >= 0).sum(), 1) for own in at]
        enough = kind == "view_whole" or (
            all(s > least for s, least in zip(shares, SHARED, strict=True))
            and max(shares) > SHARED_BY_ONE
        )
        sizes = [len(part.mesh.vertices) for part in parts]
        if enough and both.sum() >= MIN_POINTS and min(sizes) >= MIN_VERTICES:
            break
    else:
        return None
    turns = np.eye(3), Rotation.from_quat(rng.normal(size=4)).as_matrix()
    factors = np.exp(SIZE * rng.normal()), 1.0
    first, second = (
        datasets.Shape(
            Mesh(
                factor / np.sqrt(surface_area(s.mesh)) * p.mesh.vertices @ turn.T,
                p.mesh.faces,
            ),
            own[both][:TRUTH],
            None,
        )
        for s, p, turn, factor, own in zip(
            samples, parts, turns, factors, at, strict=True
        )
    )
    return first, second


def _place(sample: Sample, part: Submesh) -> np.ndarray:
    """The vertex of the part for each point of ground truth; -1 for none."""
    at = np.full(len(sample.mesh.vertices), -1)
    at[part.index] = np.arange(len(part.index))
    return at[sample.template_to_vertex]


def _view_whole(x: Sample, y: Sample, rng) -> tuple[Submesh, Submesh]:
    whole = Submesh(y.mesh, np.arange(len(y.mesh.vertices)))
    return seen(x.mesh, rng.normal(size=3), rng), whole


def _view_view(x: Sample, y: Sample, rng) -> tuple[Submesh, Submesh]:
    """From nearly the same side, as the bodies stand."""
    camera = rng.normal(size=3)
    camera /= np.linalg.norm(camera)
    a, b = (
        s.mesh.vertices[s.template_to_vertex]
        - s.mesh.vertices[s.template_to_vertex].mean(0)
        for s in (x, y)
    )
    turned = closest_rotations(b.T @ a) @ camera
    other = turned + SPREAD * rng.normal(size=3)
    return seen(x.mesh, camera, rng), seen(y.mesh, other, rng)


def _cuts(x: Sample, y: Sample, rng) -> tuple[Submesh, Submesh]:
    one, other = (
        (cuts.plane if rng.random() < 0.6 else cuts.ball)(s, rng.uniform(*KEEP), rng)
        for s in (x, y)
    )
    return one, other


KINDS: dict[str, Callable[..., tuple[Submesh, Submesh]]] = {
    "view_whole": _view_whole,
    "view_view": _view_view,
    "cuts": _cuts,
}


def seen(mesh: Mesh, camera: np.ndarray, rng: np.random.Generator) -> Submesh:
    """The largest piece of the faces that are seen from far away in a direction.

    Points of the surface are drawn in a picture that keeps the depth of the nearest.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    ahead = camera / np.linalg.norm(camera)
    right = np.cross(ahead, np.eye(3)[np.abs(ahead).argmin()])
    right /= np.linalg.norm(right)
    at = vertices @ np.stack([right, np.cross(ahead, right), ahead], 1)
    low = at[:, :2].min(0)
    width = (at[:, :2].max(0) - low).max()
    pixel = lambda p: tuple(
        np.minimum((p[:, :2] - low) / width * PIXELS, PIXELS - 1).astype(int).T
    )
    sides = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    normal = np.cross(sides[:, 0], sides[:, 1])
    area = np.linalg.norm(normal, axis=1)
    of = rng.choice(len(faces), POINTS, p=area / area.sum())
    a, b = np.sqrt(rng.random(POINTS)), rng.random(POINTS)
    corners = np.stack([1 - a, a * (1 - b), a * b], 1)
    points = np.einsum("pc,pcd->pd", corners, at[faces[of]])
    depth = np.full((PIXELS, PIXELS), -np.inf)
    np.maximum.at(depth, pixel(points), points[:, 2])
    middle = at[faces].mean(1)
    front = normal @ ahead > FACING * area
    nearest = middle[:, 2] >= depth[pixel(middle)] - BEHIND * width
    return largest_component(Mesh(vertices, faces[front & nearest]))
