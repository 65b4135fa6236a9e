"""Fit the weights by which `jfsf.apps.plot` finds up and front, and look at what it
finds.

Of each shape whose axes are known the right frame is to score above all others that
the search tries: softmax regression, each --data counted as much as the others. --fit
prints the weights for jfsf/apps/plot/_upright.py. Without it the frames that the
package finds are compared with the known axes. --sheet draws every shape in its frame.

    python experiments/upright.py --embedded --data yz "people/*.off" \\
        --data z-y "animals/cat*.off" "animals/dog*.off"
"""

import argparse
import re
from glob import glob
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import jfsf
from jfsf.apps.plot import draw_shape
from jfsf.apps.plot._cues import Cues, apart, cues, front_cues, up_cues
from jfsf.apps.plot._page import picture_of
from jfsf.apps.plot._upright import FRONTS, TRIED, UP_WEIGHTS, circle, find_frame
from jfsf.data import load, names

NEAR = 16.0, 32.0  # degrees: a frame this near in up and in front is right
RIDGE = 0.01
ROUNDS = 4
OTHERS = 25  # one in so many
COLUMNS = 12


class Tried(NamedTuple):
    """The frames of a shape that a search tries: their cues, and which are right."""

    cues: np.ndarray
    right: np.ndarray
    group: str


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--embedded", action="store_true", help="shapes of the package")
    parser.add_argument(
        "--data",
        nargs="+",
        action="append",
        default=[],
        metavar=("AXES", "FILES"),
        help="up and front, such as yz or z-y, of the files of these patterns",
    )
    parser.add_argument("--skip", nargs="*", default=[], help="shapes to leave out")
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--sheet", type=Path, help="PNG of all shapes, not to be kept")
    args = parser.parse_args()
    shapes = [(n, load(n).mesh, "embedded", "y", "z") for n in names() if args.embedded]
    for axes, *patterns in args.data:
        up, front = re.findall("-?[xyz]", axes)
        for path in sorted(path for pattern in patterns for path in glob(pattern)):
            shapes.append((Path(path).stem, jfsf.read(path), patterns[0], up, front))
    shapes = [shape for shape in shapes if shape[0] not in args.skip]
    if args.fit:
        fit(shapes)
    else:
        compare(shapes)
    if args.sheet:
        sheet([(name, mesh) for name, mesh, *_ in shapes], args.sheet)


def fit(shapes) -> None:
    """Print the weights."""
    known = [(cues(mesh), axis(up), axis(front), g) for _, mesh, g, up, front in shapes]
    up, rounds = UP_WEIGHTS, []
    for _ in range(ROUNDS):  # a search tries the best by the weights of the last round
        rounds.append(regression([tried(*shape, up) for shape in known]))
        up = rounds[-1][: len(up)]
    # They do not settle, but alternate.
    up, front = np.split(np.mean(rounds[-2:], 0).round(2), [len(up)])
    print(f"UP_WEIGHTS = {up.tolist()}\nFRONT_WEIGHTS = {front.tolist()}")


def tried(seen: Cues, up, front, group: str, weights) -> Tried:
    """The right frame and those that a search with these weights for up tries."""
    order = np.argsort(-up_cues(seen, seen.ups) @ weights, kind="stable")
    ups = apart(seen.ups[order], 8.0, TRIED)
    # Others too, or the weights would not keep them from being tried.
    right_up = seen.ups[[np.argmax(seen.ups @ up)]]
    ups = np.concatenate([ups, right_up, seen.ups[::OTHERS]])
    rows, right = [], []
    for this, of_up in zip(ups, up_cues(seen, ups), strict=True):
        fronts = circle(this, FRONTS)
        of_front = front_cues(seen, this, fronts)
        rows.append(np.c_[np.tile(of_up, (FRONTS, 1)), of_front])
        right.append((angle(this, up) < NEAR[0]) & (angle(fronts, front) < NEAR[1]))
    return Tried(np.concatenate(rows), np.concatenate(right), group)


def regression(shapes: list[Tried]) -> np.ndarray:
    """Weights of the cues by softmax over the frames of each shape."""
    shapes = [shape for shape in shapes if shape.right.any()]
    scale = np.concatenate([shape.cues for shape in shapes]).std(0)
    groups = [shape.group for shape in shapes]

    def loss(weights):
        total, slope = RIDGE * weights @ weights / 2, RIDGE * weights
        for values, right, group in shapes:
            values = values / scale
            score = values @ weights
            chance = np.exp(score - score.max())
            chance = chance / chance.sum()
            among = chance * right / (chance @ right + 1e-12)
            count = groups.count(group) * len(set(groups))
            total -= np.log(chance @ right + 1e-12) / count
            slope = slope - (among - chance) @ values / count
        return total, slope

    found = minimize(loss, np.zeros(len(scale)), jac=True, method="L-BFGS-B")
    return found.x / scale


def compare(shapes) -> None:
    """Print how many frames are near the known axes, by folder, and the others."""
    rows: dict[str, list] = {}
    for name, mesh, group, up, front in shapes:
        found = find_frame(mesh)
        _, y, z = found.axes.T
        row = name, angle(y, axis(up)), angle(z, axis(front)), found.margin
        rows.setdefault(group, []).append(row)
    for group, found in rows.items():
        up = np.array([row[1] for row in found]) < 25
        both = up & (np.array([row[2] for row in found]) < 45)
        print(
            f"{group}: {len(found)} shapes, up {up.mean():.0%}, both {both.mean():.0%}"
        )
        for row, right in zip(found, both, strict=True):
            if not right:
                print("  {}: up {:.0f}, front {:.0f}, margin {:.1f}".format(*row))


def sheet(shapes, path: Path) -> None:
    """All shapes as the package draws them."""
    high = -(-len(shapes) // COLUMNS)
    figure, axes = plt.subplots(high, COLUMNS, figsize=(COLUMNS * 1.3, high * 1.4))
    for axis in axes.flat:
        axis.axis("off")
    for (name, mesh), axis in zip(shapes, axes.flat, strict=False):
        axis.imshow(picture_of(draw_shape(mesh), 40))
        axis.set_title(name, size=6, pad=1)
    figure.tight_layout(pad=0.2)
    figure.savefig(path, dpi=100)


def axis(name: str) -> np.ndarray:
    """The direction that "x" or "-y" names."""
    return np.eye(3)["xyz".index(name[-1])] * (-1 if name[0] == "-" else 1)


def angle(directions, other) -> np.ndarray:
    """In degrees."""
    return np.degrees(np.arccos(np.clip(directions @ other, -1, 1)))


if __name__ == "__main__":
    main()
