"""Maps that are right in all but their side: does the confidence see that?

Of each pair three twins are made from the ground truth, exact point-to-point maps that
keep orientation: the body turned round as a whole (front on back, left on right), the
same above the waist only, and the two arms or the two legs exchanged. Each is handed to
`jfsf.match` as `initial`. Where the refinement repairs it, to a mean error below 0.1,
the match is right, and is counted apart. The others are wrong, and are to have a
confidence below 0.5.

The embedded pairs are reported; those of the creatures teach calibration.py what wrong
maps of near shapes look like.

    python -m experiments.accuracy.twins [embedded | creatures] [--data ROOT] \\
        [--pairs N]
"""

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.spatial import KDTree

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.damages import TEMPLATE_POSE
from jfsf import data
from jfsf.evaluate import geodesic_error

SURE = 0.5  # a wrong map is to have less confidence
SETS = "embedded", "creatures"
KINDS = ("turned", "twisted", "exchanged")
PARTS = ("arms", "legs")
# In T-pose: |x| as a share of half the width, and y of the height.
ARM, LEG, WAIST, BELT = 0.36, 0.46, 0.62, 0.05
DEPTH = 0.012  # points this near in x and y, as a share of the height, tell the depth


class Template(NamedTuple):
    """The template points in a symmetric upright pose: y up, facing z.

    points: (n, 3).
    mirrored: (n, 3) where the mirror image of each is.
    arm, leg: (n,) whether a point belongs to one.
    """

    points: np.ndarray  # type: ignore
    mirrored: np.ndarray  # type: ignore
    arm: np.ndarray  # type: ignore
    leg: np.ndarray  # type: ignore


def main() -> None:
    parser = command_line.parser(__doc__, data="optional")
    parser.add_argument("set", nargs="?", default="embedded", choices=SETS)
    parser.add_argument("--pairs", type=int, default=20, help="of all, evenly spread")
    parser.add_argument("--every", type=int, default=50, help="template points: 1 in N")
    args = command_line.parse(parser)
    out = args.out or command_line.RESULTS / f"twins_{args.set}.json"
    rows = []
    for i, (names, x, y) in enumerate(shapes(args.set, args.pairs, Path(args.data))):
        for kind, T_xy in twins(x, y, PARTS[i % 2]).items():
            row = {"x": names[0], "y": names[1], "kind": kind}
            if kind == "exchanged":
                row["part"] = PARTS[i % 2]
            rows.append(row | _measure(x, y, T_xy, args.every))
            print(
                rows[-1]["x"], rows[-1]["y"], kind, rows[-1]["confidence"], flush=True
            )
    table = summary(rows)
    print(table)
    settings = {**jfsf.Settings().as_record(), "right": protocol.RIGHT, "sure": SURE}
    results_file.write(out, settings=settings, rows=table, pairs=rows)


def shapes(name: str, number: int, root: Path):
    """So many pairs of a set of the protocol, evenly spread: names, X and Y."""
    row = protocol.SETS[name]
    if name == "embedded":  # all pairs, not those that the set is made of
        row = row._replace(number=0)
    data_set = protocol.below(row, root)
    for pair in datasets.spread(datasets.pairs_of(data_set), number):
        yield (pair.x, pair.y), *datasets.load_pair_of(data_set, pair)


def twins(
    x: datasets.Shape, y: datasets.Shape, part: str = "arms"
) -> dict[str, np.ndarray]:
    """T_xy of each kind, for two shapes with the template points of the embedded ones.

    Args:
        x, y: with the vertex of each template point.
        part: which are exchanged, "arms" or "legs".
    """
    partners = exchanges(embedded_template(), part)
    return {kind: as_map(x, y.truth, to) for kind, to in partners.items()}


def as_map(x: datasets.Shape, truth_y: np.ndarray, partners: np.ndarray) -> np.ndarray:
    """T_xy that takes each template point to that point of Y which is its partner."""
    vertices = x.mesh.vertices
    # Three vertices in ten have no template point: that of the nearest with one.
    nearest = np.asarray(KDTree(vertices[x.truth]).query(vertices)[1])
    return truth_y[partners[nearest]].astype(np.int32)


def embedded_template() -> Template:
    """That of the embedded shapes, from the body in T-pose."""
    pose = data.load(TEMPLATE_POSE)
    points = pose.mesh.vertices[pose.template_to_vertex]
    low, high = points.min(0), points.max(0)
    points = points - [(low[0] + high[0]) / 2, low[1], 0]
    height = high[1] - low[1]
    arm = np.abs(points[:, 0]) > ARM * (high[0] - low[0]) / 2
    leg = points[:, 1] < LEG * height
    return Template(points, points * [-1, 1, 1], arm, leg)


def exchanges(template: Template, part: str) -> dict[str, np.ndarray]:
    """The partner of each template point, for each kind of twin."""
    same = np.arange(len(template.points))
    turn = turned(template)
    moved = getattr(template, part.removesuffix("s"))
    return {
        "turned": turn,
        "twisted": _twisted(template, turn),
        "exchanged": np.where(moved, turn, same),
    }


def turned(template: Template) -> np.ndarray:
    """The partner of each point if the body is turned about its vertical axis.

    The mirror image, with front and back exchanged where it is: so each limb comes onto
    the other one of its kind, toes on heels.
    """
    points, mirrored = template.points, template.mirrored.copy()
    front, back = _depths(points, mirrored)
    mirrored[:, 2] = front + back - mirrored[:, 2]
    return _nearest(template, mirrored)


def _depths(points: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest and the smallest z of the points with about the same x and y."""
    tree = KDTree(points[:, :2])
    near = tree.query_ball_point(at[:, :2], DEPTH * np.ptp(points[:, 1]))
    z = [points[own, 2] if own else row[2:] for own, row in zip(near, at, strict=True)]
    return np.array([v.max() for v in z]), np.array([v.min() for v in z])


def _nearest(template: Template, at: np.ndarray) -> np.ndarray:
    return np.asarray(KDTree(template.points).query(at)[1])


def _twisted(template: Template, turn: np.ndarray) -> np.ndarray:
    """`turn` above the waist; in a belt there the angle grows from 0 to 180."""
    points = template.points
    height = (points[:, 1] - points[:, 1].min()) / np.ptp(points[:, 1])
    share = np.clip((height - WAIST) / BELT + 0.5, 0, 1)
    share[template.arm], share[template.leg] = 1, 0
    partners = np.where(share == 1, turn, np.arange(len(points)))
    belt = np.flatnonzero((share > 0) & (share < 1))
    # The section of a body is about an ellipse: turned, it is to come onto itself.
    low, high = points[belt].min(0), points[belt].max(0)
    middle, half = (high + low) / 2, (high - low) / 2
    x, z = ((points[belt] - middle) / half)[:, [0, 2]].T
    cos, sin = np.cos(np.pi * share[belt]), np.sin(np.pi * share[belt])
    around = np.stack([cos * x - sin * z, points[belt, 1], sin * x + cos * z], 1)
    around[:, [0, 2]] = around[:, [0, 2]] * half[[0, 2]] + middle[[0, 2]]
    partners[belt] = _nearest(template, around)
    return partners


def _measure(
    x: datasets.Shape, y: datasets.Shape, T_xy: np.ndarray, every: int
) -> dict:
    truth = x.truth[::every], y.truth[::every]
    found = jax.block_until_ready(jfsf.match(x.mesh, y.mesh, initial=T_xy))
    given, error = (
        float(geodesic_error(np.asarray(own), y.mesh, *truth).mean())
        for own in (T_xy, found.T_xy)
    )
    figures = {k: float(v) for k, v in found.certificate.figures().items()}
    attempt = {"source": "given", "error": error, **figures}
    repaired = protocol.is_right(error)
    row = {"twin_error": given, "repaired": repaired, "error": error, **figures}
    return {**row, "attempts": [attempt]}


def summary(rows: list[dict]) -> dict:
    """Of each kind and of all: how many are wrong, and how many of those doubted."""
    table = {}
    for kind in (*KINDS, "all"):
        own = [row for row in rows if kind in (row["kind"], "all")]
        wrong = [row for row in own if not row["repaired"]]
        table[kind] = {
            "twins": len(own),
            "repaired": len(own) - len(wrong),
            "wrong": len(wrong),
            "doubted": sum(row["confidence"] < SURE for row in wrong),
            "highest": max((row["confidence"] for row in wrong), default=None),
        }
    return table


if __name__ == "__main__":
    main()
