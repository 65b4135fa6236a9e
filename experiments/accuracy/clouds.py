"""Embedded pairs with the faces of one shape or both dropped: errors and warnings.

A row is the side without faces, and the noise on it: Gaussian, on each coordinate, in
sqrt(area). The error is measured on Y with its faces. A map is mirrored if its error
against the ground truth with left and right exchanged is less than against the truth.

    python -m experiments.accuracy.clouds [--pairs 5] [--noise 0 0.005] \\
        [--out RESULT.json]
"""

from functools import cache

import jax
import numpy as np
from scipy.spatial import KDTree

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import damages
from experiments.accuracy.damage import PAIRS, summary
from experiments.accuracy.damages import TEMPLATE_POSE
from experiments.accuracy.protocol import RIGHT
from jfsf import data
from jfsf.apps.report._words import warnings_of
from jfsf.data import Sample
from jfsf.evaluate import geodesic_error
from jfsf.types import Mesh

SIDES = ("y", "x", "both")


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("--pairs", type=int, default=len(PAIRS), help="only the first")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 0.005])
    parser.add_argument("--sides", nargs="+", choices=SIDES, default=list(SIDES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=5, help="template points: 1 in N")
    args = command_line.parse(parser)
    settings = {
        **jfsf.Settings().as_record(),
        **{"seed": args.seed, "every": args.every, "right": RIGHT},
    }
    table, rows = {}, []
    for noise in args.noise:
        for side in args.sides:
            rng = np.random.default_rng(args.seed)
            found = [
                _measure(*pair, side, noise, rng, args.every)
                for pair in PAIRS[: args.pairs]
            ]
            rows += found
            name = f"{side}, noise {noise:.1%}"
            table[name] = _summary(found)
            print(name, table[name], flush=True)
            if args.out:
                results_file.write(args.out, settings=settings, rows=table, pairs=rows)


@cache
def mirrored_template() -> np.ndarray:
    """The template point on the other side, for each template point."""
    pose = data.load(TEMPLATE_POSE)
    points = pose.mesh.vertices[pose.template_to_vertex]
    return np.asarray(KDTree(points).query(points * [-1, 1, 1])[1])


def _cloud(sample: Sample, noise: float, rng: np.random.Generator) -> Mesh:
    mesh = damages.noise(sample, rng, size=noise).mesh
    return Mesh(mesh.vertices, mesh.faces[:0])


def _measure(name_x, name_y, side, noise, rng, every) -> dict:
    sample_x, sample_y = data.load(name_x), data.load(name_y)
    x, y = (
        _cloud(sample, noise, rng) if side in (one, "both") else sample.mesh
        for one, sample in (("x", sample_x), ("y", sample_y))
    )
    found = jax.block_until_ready(jfsf.match(x, y))
    T_xy = np.asarray(found.T_xy)
    at = slice(None, None, every)
    points, truth = sample_x.template_to_vertex[at], sample_y.template_to_vertex
    error, other = (
        float(geodesic_error(T_xy, sample_y.mesh, points, partners[at]).mean())
        for partners in (truth, truth[mirrored_template()])
    )
    certificate = found.certificate
    row = {
        **{"side": side, "noise": noise, "x": name_x, "y": name_y},
        **{"error": error, "exchanged": other < error, "right": error < RIGHT},
        "warnings": warnings_of(certificate, "preserve"),
        **{name: float(value) for name, value in certificate.figures().items()},
    }
    print(
        f"  {name_x} {name_y} error {error:.4f} confidence {row['confidence']:.2f} "
        f"orientation {row['orientation']:+.2f}{' EXCHANGED' * row['exchanged']} "
        f"{'; '.join(row['warnings'])}",
        flush=True,
    )
    return row


def _summary(rows: list[dict]) -> dict:
    return {**summary(rows), "exchanged": sum(row["exchanged"] for row in rows)}


if __name__ == "__main__":
    main()
