"""Shapes that are no people: the network is to say nothing of them.

Animals on four, six or no legs, birds, tools, bones and skulls, made of tubes that
merge smoothly, and of hollows; most are mirror images of themselves, as bodies are.

    pip install scikit-image
"""

import numpy as np
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

from jfsf.mesh import largest_component
from jfsf.types import Mesh

GRID = 72  # points along each side of the box


def random_other(rng: np.random.Generator) -> Mesh:
    """A closed surface of some 10 000 vertices."""
    kind = rng.choice(list(KINDS))
    tubes = KINDS[kind](rng)
    hollows = _hollows(tubes, rng) if rng.random() < HOLLOW.get(kind, 0) else []
    bones = np.array([(*a, *b) for a, b, _, _ in tubes + hollows])
    radii = np.array([(one, other) for _, _, one, other in tubes + hollows])
    bones *= np.tile(np.exp(0.25 * rng.normal(size=3)), 2)
    low = (bones.reshape(-1, 3) - radii.max()).min(0) - 0.1
    high = (bones.reshape(-1, 3) + radii.max()).max(0) + 0.1
    step = (high - low).max() / GRID
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    blend, n = rng.uniform(0.02, 0.1), len(tubes)
    depth = _union(points.reshape(-1, 3), bones[:n], radii[:n], blend)
    if hollows:
        without = _union(points.reshape(-1, 3), bones[n:], radii[n:], 0.3 * blend)
        depth = np.maximum(depth, -without)
    wave = Rotation.from_quat(rng.normal(size=4)).as_matrix() @ points[..., None]
    depth = depth.reshape(points.shape[:3])
    rough = rng.uniform(0, 0.03) * np.sin(rng.uniform(4, 14) * wave[..., 0]).prod(-1)
    vertices, faces, _, _ = marching_cubes(depth + rough, 0.0)
    return largest_component(Mesh(low + step * vertices, faces)).mesh


def _union(points, bones, radii, blend) -> np.ndarray:
    """Signed distance to tubes, smaller where they meet."""
    total = np.zeros(len(points))
    for bone, (first, last) in zip(bones, radii, strict=True):
        a, b = bone[:3], bone[3:]
        along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-9), 0, 1)
        away = np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
        away -= first + along * (last - first)
        total += np.exp(-np.minimum(away / blend, 30))
    return -blend * np.log(np.maximum(total, 1e-12))


def _limb(start, way, length, radius, rng) -> list:
    """Two or three tubes, one after the other, and perhaps a foot."""
    tubes, at = [], np.asarray(start, float)
    for _ in range(rng.integers(2, 4)):
        way = way + 0.35 * rng.normal(size=3)
        end = at + length / 2.5 * way / np.linalg.norm(way)
        tubes.append((at, end, radius, 0.75 * radius))
        at, radius = end, 0.75 * radius
    if rng.random() < 0.5:
        tubes.append((at, at + 0.15 * length * np.array([1.0, 0, 0]), radius, radius))
    return tubes


def _both(tubes: list) -> list:
    """With their mirror images in the plane y = 0."""
    flip = np.array([1.0, -1, 1])
    return tubes + [(flip * a, flip * b, *radii) for a, b, *radii in tubes]


def _animal(rng) -> list:
    """A trunk along x, legs below it, a neck with a head, a tail, ears."""
    size, thick = rng.uniform(0.6, 1.6), rng.uniform(0.12, 0.35)
    front, back = np.array([size / 2, 0, 0]), np.array([-size / 2, 0, 0])
    belly = rng.uniform(0.8, 1.3) * thick
    tubes = [(front, np.zeros(3), thick, belly), (np.zeros(3), back, belly, thick)]
    legs = rng.uniform(0.3, 1.2)
    for x in np.linspace(-size / 2, size / 2, rng.choice([2, 2, 2, 2, 3, 4])):
        start = np.array([x, 0.7 * thick, -0.2 * thick])
        down = np.array([0.0, 0.15, -1.0])
        tubes += _both(_limb(start, down, legs, rng.uniform(0.05, 0.12), rng))
    up = np.array([rng.uniform(0.2, 1), 0, rng.uniform(-0.2, 1)])
    neck = rng.uniform(0.2, 1.0) * (2.5 if rng.random() < 0.2 else 1)
    head = front + neck * up / np.linalg.norm(up)
    tubes.append((front, head, 0.6 * thick, 0.4 * thick))
    nose = head + rng.uniform(0.1, 0.4) * np.array([1, 0, rng.uniform(-0.7, 0.1)])
    tubes.append((head, nose, rng.uniform(0.4, 0.8) * thick, 0.3 * thick))
    if rng.random() < 0.7:
        ear = head + np.array([-0.05, 0.12, rng.uniform(0.1, 0.3)])
        tubes += _both([(head, ear, 0.05, 0.03)])
    if rng.random() < 0.8:
        way = np.array([-1, 0, rng.uniform(-1, 0.6)])
        tubes += _limb(back, way, rng.uniform(0.2, 1.3), 0.08, rng)
    return tubes


def _bird(rng) -> list:
    """A trunk, wings, a tail; fish and planes are made alike."""
    size, thick = rng.uniform(0.8, 1.6), rng.uniform(0.1, 0.3)
    front, back = np.array([size / 2, 0, 0]), np.array([-size / 2, 0, 0])
    tubes = [(front, back, thick, 0.4 * thick)]
    for x in rng.uniform(-0.4, 0.4, rng.integers(1, 3)) * size:
        way = np.array([rng.uniform(-0.6, 0.2), 1.0, rng.uniform(-0.3, 0.6)])
        wing = _limb([x, 0, 0], way, rng.uniform(0.3, 1.5), 0.1, rng)
        tubes += _both(wing)
    tubes.append((back, back + [-0.2, 0, rng.uniform(-0.3, 0.4)], 0.1, 0.04))
    return tubes


def _tool(rng) -> list:
    """A few tubes in a row or a star: tools, bones, plants, tables."""
    tubes, ends = [], [np.zeros(3)]
    for _ in range(rng.integers(1, 8)):
        start = ends[rng.integers(len(ends))]
        way = rng.normal(size=3)
        end = start + rng.uniform(0.2, 1.2) * way / np.linalg.norm(way)
        tubes.append((start, end, *rng.uniform(0.06, 0.3, 2)))
        ends.append(end)
    return _both(tubes) if rng.random() < 0.5 else tubes


def _skull(rng) -> list:
    """A lump or two, a snout, and arches that leave tunnels between them and it."""
    size, thick = rng.uniform(0.5, 1.4), rng.uniform(0.25, 0.5)
    front = np.array([size, 0, rng.uniform(-0.3, 0.1)])
    tubes = [(np.zeros(3), 0.3 * front, thick, 0.8 * thick)]
    tubes.append((0.3 * front, front, 0.6 * thick, rng.uniform(0.15, 0.5) * thick))
    for _ in range(rng.integers(1, 4)):
        wide = rng.uniform(1.1, 1.8) * thick
        first, last = np.sort(rng.uniform(-0.1, 0.9, 2))
        low = rng.uniform(-0.6, 0.4) * thick
        middle = np.array([(first + last) / 2 * size, wide, low])
        radius = rng.uniform(0.04, 0.1)
        for end in (first, last):
            at = end * front + [0, 0.3 * thick, 0.5 * low]
            tubes += _both([(at, middle, radius, radius)])
    return tubes


def _hollows(tubes: list, rng) -> list:
    """Balls and tunnels across, to be taken away."""
    found = []
    for _ in range(rng.integers(1, 4)):
        a, b, one, other = tubes[rng.integers(len(tubes))]
        at, radius = a + rng.random() * (b - a), rng.uniform(0.2, 0.7) * min(one, other)
        way = rng.normal(size=3) if rng.random() < 0.5 else np.zeros(3)
        found += _both([(at + way, at + rng.normal(size=3) * radius, radius, radius)])
    return found


KINDS = {"animal": _animal, "bird": _bird, "tool": _tool, "skull": _skull}
# Shares of what has hollows. By hand.
HOLLOW = {"tool": 0.3, "skull": 0.7}
