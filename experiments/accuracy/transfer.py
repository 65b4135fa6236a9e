"""Labels, landmarks, values and a texture, carried along the maps of embedded pairs.

X gets what Y has, by the map of `jfsf.match`, and by the ground truth made a map: the
difference is the map's own error. Errors are in sqrt(area of X or Y) where they are
distances.

- labels: head, arms, legs and trunk of the base mesh, at Y's vertices; the share of the
  vertices of X, and of its area by faces, that get the right one
- landmarks: 16 points of the base mesh, spread over it, at Y's vertices; the mean
  distance on X from their true vertices.
- values: Y's coordinates; mean distance from the true partners of X's vertices.
  `snapped` is that of `y.vertices[T_xy]`
- texture: Y has charts by the direction of its normals, and an image whose colours are
  positions. Smeared is the share of X's area where a channel is more than 8 of 255 off
  the colour of the point of Y; `one_uv` the same with one texture coordinate a vertex

    python -m experiments.accuracy.transfer --spread 10 --maps FOLDER \\
        --out experiments/results/transfer.json --png experiments/results/transfer.png
"""

from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets
from experiments.accuracy.protocol import SETS
from jfsf import data
from jfsf.apps import transfer
from jfsf.apps.landmarks import Landmarks
from jfsf.apps.mapfiles import read_match, write_match
from jfsf.apps.transfer._overlay import Overlay
from jfsf.apps.transfer._texture import look_up
from jfsf.mesh import closest, surface_area
from jfsf.mesh._closest import surface_tree
from jfsf.mesh._geometry import components, face_areas, face_normals, vertex_normals
from jfsf.types import Mesh

PARTS = "trunk", "head", "left arm", "right arm", "left leg", "right leg"
BASE = "man_t"
LANDMARKS, IMAGE, BAKED = 16, 2048, 2048
SAMPLES = 16  # of a face, for the smear
OFF = 8  # of 255
SMOOTHED = 4  # times, for the stripes of the picture
SHOWN = ("child_up", "man_walk")  # X and Y of the picture


class Chart(NamedTuple):
    """Texture coordinates of Y's faces, and its image."""

    uv: np.ndarray
    image: np.ndarray


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("--spread", type=int, help="only N pairs, spread over all")
    parser.add_argument("--maps", type=Path, help="folder that keeps the matches")
    parser.add_argument("--png", type=Path, help="a picture of one pair")
    args = command_line.parse(parser)
    settings = {
        "role": SETS["embedded"].role(0),
        "spread": args.spread,
        "parts": PARTS,
        "landmarks": LANDMARKS,
        "image": IMAGE,
        "baked": BAKED,
    }
    rows = []
    pairs = datasets.spread(list(permutations(data.names(), 2)), args.spread)
    for pair in pairs:
        rows.append({"x": pair[0], "y": pair[1], **measure(args.maps, *pair)})
        print(rows[-1], flush=True)
        if args.out:
            results_file.write(
                args.out, settings=settings, summary=summary(rows), pairs=rows
            )
    print(summary(rows), flush=True)
    if args.png:
        draw(args.maps, args.png, *SHOWN)


def measure(maps: Path | None, name_x: str, name_y: str) -> dict:
    """A row: by the map that was found, and by the true one."""
    x, y = data.load(name_x), data.load(name_y)
    found = match(maps, name_x, name_y)
    T_xy = np.asarray(found.T_xy)
    row: dict = {"confidence": float(found.certificate.confidence)}
    both = transfer.overlay(x.mesh, y.mesh, T_xy)
    row["map"] = _figures(x, y, both, T_xy)
    row["map"]["texture"] = _smear(both, T_xy)
    T_xy = true_map(x, y)
    row["truth"] = _figures(x, y, transfer.overlay(x.mesh, y.mesh, T_xy), T_xy)
    return row


def summary(rows: list[dict]) -> dict:
    """Means over all pairs, those of one body and the others; the largest smear."""
    leaves = lambda tree: {
        f"{key}.{name}" if name else key: value
        for key, sub in tree.items()
        for name, value in (leaves(sub) if isinstance(sub, dict) else {"": sub}).items()
    }
    flat = [leaves({k: row[k] for k in ("map", "truth")}) for row in rows]
    mean = lambda own: {n: float(np.mean([row[n] for row in own])) for n in flat[0]}
    body = lambda name: name.split("_")[0]
    one = [
        f for f, row in zip(flat, rows, strict=True) if body(row["x"]) == body(row["y"])
    ]
    other = [f for f in flat if f not in one]
    found = {"pairs": len(rows), "all": mean(flat)}
    if one and other:
        found |= {"pairs_of_one_body": len(one), "one_body": mean(one)}
        found |= {"other_bodies": mean(other)}
    worst = [row["map.texture.smeared"] for row in flat]
    return found | {"smeared_max": float(np.max(worst))}


def match(maps: Path | None, name_x: str, name_y: str):
    """The match of a pair, kept in a folder."""
    path = maps and maps / f"{name_x}__{name_y}.npz"
    if path and path.exists():
        return read_match(path)
    found = jfsf.match(data.load(name_x).mesh, data.load(name_y).mesh)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_match(path, found)
    return found


def true_map(x: data.Sample, y: data.Sample) -> np.ndarray:
    """T_xy of the ground truth; a vertex without a partner takes its neighbour's."""
    T = np.full(len(x.mesh.vertices), -1)
    T[x.template_to_vertex] = y.template_to_vertex
    known = np.flatnonzero(T >= 0)
    near = KDTree(x.mesh.vertices[known]).query(x.mesh.vertices)[1]
    return T[known[near]]


def parts_of(sample: data.Sample) -> tuple[np.ndarray, np.ndarray]:
    """The part of each vertex, a number of `PARTS`, and whether the truth names it."""
    base = data.load(BASE)
    x, y, _ = base.mesh.vertices[base.template_to_vertex].T
    part = np.where(y > 0.67, 1, 0)
    arm = (np.abs(x) > 0.2) & (y > 0.4)
    leg = y < -0.15
    part = np.where(arm, 2 + (x < 0), np.where(leg, 4 + (x < 0), part))
    votes = np.zeros((len(sample.mesh.vertices), len(PARTS)), int)
    np.add.at(votes, (sample.template_to_vertex, part), 1)
    known = np.asarray(votes.any(1))
    near = KDTree(sample.mesh.vertices[known]).query(sample.mesh.vertices)[1]
    return votes.argmax(1)[np.flatnonzero(known)[near]], known


def _figures(x, y, both, T_xy) -> dict:
    """Labels, landmarks and values of one map."""
    (of_x, known), (of_y, _) = parts_of(x), parts_of(y)
    vertices = transfer.labels(both, of_y)
    by_face = transfer.labels(both, of_y, to="faces")
    corner = of_x[x.mesh.faces]
    inside = (corner == corner[:, :1]).all(1)
    most = np.where(corner[:, 1] == corner[:, 2], corner[:, 1], corner[:, 0])
    area = face_areas(*x.mesh)
    right = np.where(inside, by_face == corner[:, 0], by_face == most)
    unit_x, unit_y = (np.sqrt(surface_area(s.mesh)) for s in (x, y))
    points = landmark_points()
    there = y.mesh.vertices[y.template_to_vertex[points]]
    true = x.mesh.vertices[x.template_to_vertex[points]]
    marks = Landmarks(("",) * len(points), there)
    carried = transfer.landmarks(both, marks)
    away = np.linalg.norm(carried.points - true, axis=1) / unit_x
    count = np.bincount(x.template_to_vertex, minlength=len(x.mesh.vertices))
    mean = np.zeros((len(count), 3))
    np.add.at(mean, x.template_to_vertex, y.mesh.vertices[y.template_to_vertex])
    mean = mean[known] / count[known, None]
    error = lambda at: float(np.linalg.norm(at[known] - mean, axis=1).mean() / unit_y)
    return {
        "labels": {
            "vertices": float((vertices == of_x)[known].mean()),
            "area": float(area @ right / area.sum()),
        },
        "landmarks": {
            "error": float(away.mean()),
            "median": float(np.median(away)),
            "most": float(away.max()),
        },
        "values": {
            "error": error(transfer.values(both, y.mesh.vertices)),
            "snapped": error(y.mesh.vertices[T_xy]),
        },
    }


def landmark_points() -> np.ndarray:
    """Template points that are spread over the base mesh, the farthest first."""
    base = data.load(BASE)
    places = base.mesh.vertices[base.template_to_vertex]
    chosen = [int(places[:, 1].argmax())]
    away = np.full(len(places), np.inf)
    for _ in range(LANDMARKS - 1):
        own = np.linalg.norm(places - places[chosen[-1]], axis=1)
        away = np.minimum(away, own)
        chosen.append(int(away.argmax()))
    return np.array(chosen)


def _smear(both: Overlay, T_xy) -> dict:
    """Shares of X's area, by the baked image and by one texture coordinate a vertex."""
    x, y = both.mesh_x, both.mesh_y
    low, high = y.vertices.min(0), y.vertices.max(0)
    colour = lambda points: 255 * (points - low) / (high - low)
    corners = y.vertices[y.faces]
    chart = unwrapped(y, lambda face, weights: colour(weights @ corners[face]))
    baked = transfer.texture(both, chart.uv, chart.image, size=BAKED)
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], SAMPLES)
    at = lambda corners: np.einsum("wc,fcd->fwd", weights, corners)
    flat = lambda corners: at(corners).reshape(-1, corners.shape[2])
    on_y = closest(surface_tree(y), flat(both.at_x[x.faces])).position
    true = colour(on_y)
    area = np.repeat(face_areas(*x), SAMPLES)

    def share(image, uv):
        off = np.abs(look_up(image, flat(uv)) - true).max(1) > OFF
        return float(area @ off / area.sum())

    one = np.zeros((len(y.vertices), 2))
    one[y.faces] = chart.uv
    return {
        "smeared": share(baked.image, baked.uv),
        "one_uv": share(chart.image, one[T_xy][x.faces]),
        "charts": int(len(np.unique(chart_of(y)))),
    }


def chart_of(mesh: Mesh) -> np.ndarray:
    """The chart of each face: connected faces whose normals have one main direction."""
    normal = face_normals(*mesh)
    axis = np.abs(normal).argmax(1)
    way = 2 * axis + (np.take_along_axis(normal, axis[:, None], 1)[:, 0] > 0)
    edge = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, 1)], 2), 2)
    keys = edge.reshape(-1, 2) @ [len(mesh.vertices), 1]
    order = np.argsort(keys)
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    one, two = order[same] // 3, order[same + 1] // 3
    alike = way[one] == way[two]
    return components(len(mesh.faces), one[alike], two[alike])


def unwrapped(mesh: Mesh, paint) -> Chart:
    """Charts side by side, and an image with the colours of their points.

    paint: a face and barycentric coordinates (q, 3) -> colours (q, 3) up to 255.
    """
    chart, normal = chart_of(mesh), face_normals(*mesh)
    axis = np.abs(normal).argmax(1)
    kept = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    corners = mesh.vertices[mesh.faces]
    flat = np.take_along_axis(corners, np.repeat(kept[:, None], 3, 1), 2)
    number = chart.max() + 1
    low, high = np.full((number, 2), np.inf), np.full((number, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(1))
    np.maximum.at(high, chart, flat.max(1))
    first, texel = _shelves(high - low)
    at = (flat - low[chart][:, None]) / texel + first[chart][:, None]  # in texels
    colours = np.zeros((IMAGE, IMAGE, 3))
    filled = np.zeros((IMAGE, IMAGE), bool)
    for face in range(len(at)):
        column, row = np.floor(at[face]).astype(int).T
        rows, columns = np.mgrid[
            row.min() : row.max() + 1, column.min() : column.max() + 1
        ]
        texels = np.stack([columns, rows], 2).reshape(-1, 2) + 0.5
        system = np.vstack([at[face].T, [1, 1, 1]])
        if abs(np.linalg.det(system)) < 1e-9:
            continue
        ones = np.ones((len(texels), 1))
        weights = np.linalg.solve(system, np.hstack([texels, ones]).T).T
        own = weights.min(1) > -1e-9
        place = texels[own].astype(int)
        colours[place[:, 1], place[:, 0]] = paint(face, weights[own])
        filled[place[:, 1], place[:, 0]] = True
    # Around each chart its own colours go on, as tools for textures do it.
    near = distance_transform_edt(~filled, return_distances=False, return_indices=True)
    image = np.rint(colours[tuple(np.asarray(near))]).astype(np.uint8)
    return Chart(at / IMAGE, image[::-1])


def _shelves(sizes: np.ndarray) -> tuple[np.ndarray, float]:
    """Places (c, 2) of boxes in rows of the image, in texels, and a texel's length."""
    gap = 4
    order = np.argsort(-sizes[:, 1])
    length = float(np.sqrt(sizes.prod(1).sum())) / IMAGE
    while True:
        first, x, y, high = np.zeros_like(sizes), gap, gap, 0.0
        for i in order:
            wide, tall = sizes[i] / length + gap
            if x + wide > IMAGE:
                x, y, high = gap, y + high, 0.0
            first[i] = x, y
            x, high = x + wide, max(high, tall)
        if y + high <= IMAGE and (sizes[:, 0] / length + 2 * gap <= IMAGE).all():
            return first, length
        length *= 1.05


def draw(maps: Path | None, path: Path, name_x: str, name_y: str) -> None:
    """Y and X with a texture and with labels, and X with one uv a vertex."""
    x, y = data.load(name_x), data.load(name_y)
    T_xy = np.asarray(match(maps, name_x, name_y).T_xy)
    both = transfer.overlay(x.mesh, y.mesh, T_xy)
    chart = unwrapped(y.mesh, _clothes(y))
    baked = transfer.texture(both, chart.uv, chart.image, size=BAKED)
    one = np.zeros((len(y.mesh.vertices), 2))
    one[y.mesh.faces] = chart.uv
    parts = parts_of(y)[0]
    tints = np.array(
        [[204, 204, 204], [230, 159, 0], [86, 180, 233], [0, 158, 115], [213, 94, 0]]
        + [[0, 114, 178]]
    )
    of_x = tints[transfer.labels(both, parts, to="faces")]
    of_y = tints[parts[y.mesh.faces]].mean(1)
    at = lambda image, uv: (
        lambda f, w: look_up(image, np.einsum("qc,qcd->qd", w, uv[f]))
    )
    panels = [
        view(y.mesh, at(chart.image, chart.uv)),
        view(x.mesh, at(baked.image, baked.uv)),
        view(x.mesh, at(chart.image, one[T_xy][x.mesh.faces])),
        view(y.mesh, lambda f, w: of_y[f]),
        view(x.mesh, lambda f, w: of_x[f]),
    ]
    Image.fromarray(np.hstack(panels)).save(path)


def _clothes(sample: data.Sample):
    """Stripes, trousers and shoes; skin and hair."""
    base, n = data.load(BASE), len(sample.mesh.vertices)
    rest, count = np.zeros((n, 3)), np.bincount(sample.template_to_vertex, minlength=n)
    places = base.mesh.vertices[base.template_to_vertex]
    np.add.at(rest, sample.template_to_vertex, places)
    known = np.flatnonzero(count)
    rest[known] /= count[known, None]
    near = KDTree(sample.mesh.vertices[known]).query(sample.mesh.vertices)[1]
    rest = rest[known[near]]
    faces = sample.mesh.faces
    for _ in range(SMOOTHED):  # the truth names vertices only
        total, number = np.zeros((n, 3)), np.bincount(faces.ravel(), minlength=n)
        np.add.at(total, faces, rest[faces].mean(1)[:, None].repeat(3, 1))
        rest = total / number[:, None]

    def paint(face, weights):
        x, y, z = at = (weights @ rest[faces[face]]).T
        skin = np.tile([224.0, 172, 140], (at.shape[1], 1))
        stripe = np.where((y * 20 % 1 < 0.5)[:, None], [250, 250, 250], [30, 60, 150])
        check = ((y * 16 % 1 < 0.5) ^ (x * 16 % 1 < 0.5))[:, None]
        out = np.where((y < 0.64)[:, None] & (np.abs(x) < 0.42)[:, None], stripe, skin)
        jeans = np.where(check, [60, 80, 110], [90, 115, 150])
        out = np.where((y < 0.05)[:, None], jeans, out)
        out = np.where((y < -0.72)[:, None], [120, 20, 20], out)
        hair = (y > 0.86) | ((y > 0.74) & (z < 0.02))
        return np.where(hair[:, None], [70, 40, 20], out)

    return paint


def view(mesh: Mesh, colour, size=(420, 760)) -> np.ndarray:
    """The mesh from the front, from the right side a little, points by their depth."""
    turn = np.radians(25)
    axes = np.array(
        [[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]]
    )
    corners = (mesh.vertices @ axes.T)[mesh.faces]
    scale = 0.94 * min(s / np.ptp(corners[..., i]) for i, s in enumerate(size))
    area = face_areas(*mesh) * scale**2
    count = np.maximum(np.ceil(area * 8), 4).astype(int)
    face = np.repeat(np.arange(len(count)), count)
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], len(face))
    points = np.einsum("qc,qcd->qd", weights, corners[face])
    normals = vertex_normals(*mesh)[mesh.faces] @ axes.T
    normals = np.einsum("qc,qcd->qd", weights, normals[face])
    light = np.clip(normals @ np.array([0.3, 0.4, 0.86]), 0, 1)
    shade = (0.35 + 0.65 * light)[:, None]
    middle = (corners.reshape(-1, 3).max(0) + corners.reshape(-1, 3).min(0)) / 2
    place = (points - middle)[:, :2] * scale * [1, -1] + np.array(size) / 2
    column, row = np.clip(np.floor(place).astype(int), 0, np.array(size) - 1).T
    order = np.argsort(points[:, 2], kind="stable")
    image = np.full((size[1], size[0], 3), 255.0)
    image[row[order], column[order]] = (colour(face, weights) * shade)[order]
    return np.rint(image).astype(np.uint8)


if __name__ == "__main__":
    main()
