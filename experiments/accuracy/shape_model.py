"""Shape models of the embedded bodies, from their true correspondence.

All twelve are put in the triangulation of one of them by the ground truth
(`datasets.posed`). Their model is measured as the field does (Davies 2002; Styner et
al. 2003): compactness, generality and specificity, by the number of modes, in metres,
and as a `share` of sqrt(area). `length_change` says what the model does to limbs: the
mean over edges of how far the mean shape's lengths are from the mean lengths, relative
to these.

    python -m experiments.accuracy.shape_model
"""

import jax
import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf import data
from jfsf.apps import model
from jfsf.apps.model._quality import Distances
from jfsf.mesh._geometry import edges

COUNTS = (0, 1, 2, 3, 5, 8, 10)  # numbers of modes


def main() -> None:
    parser = command_line.parser(__doc__, out="shape_model.json")
    parser.add_argument("--template", default="man_t", choices=data.names())
    parser.add_argument("--scale", action="store_true", help="take away sizes")
    parser.add_argument("--samples", type=int, default=50, help="of specificity")
    parser.add_argument("--seed", type=int, default=0)
    args = command_line.parse(parser)
    shapes, faces = in_one_mesh(args.template)
    settings = {
        "template": args.template,
        "scale": args.scale,
        "samples": args.samples,
        "seed": args.seed,
    }
    figures = measure(shapes, faces, args)
    print(figures)
    results_file.write(
        args.out,
        settings=settings,
        shapes=list(data.names()),
        vertices=shapes.shape[1],
        models={"positions": figures},
    )


def in_one_mesh(template: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions (s, n, 3) of all embedded shapes, and the faces of the template."""
    embedded = protocol.SETS["embedded"]
    x = datasets.load_shape(embedded, template)
    own = [datasets.load_shape(embedded, name) for name in data.names()]
    shapes = np.stack([datasets.posed(x, y).mesh.vertices for y in own])
    return shapes, x.mesh.faces


def measure(shapes: np.ndarray, faces: np.ndarray, args) -> dict:
    """The figures of the model."""
    positions = jnp.asarray(shapes)
    fitted = model.fit_model(positions, faces, scale=args.scale)
    compact = model.compactness(fitted)
    general = model.generality(positions, faces, scale=args.scale, counts=COUNTS)
    special = model.specificity(
        *(fitted, positions, jax.random.key(args.seed)),
        samples=args.samples,
        counts=COUNTS[1:],
    )
    return {
        "compactness": [rounded(share) for share in compact.share],
        "generality": table(general),
        "specificity": table(special),
        "length_change": length_change(np.asarray(fitted.mean), shapes, faces),
    }


def table(distances: Distances) -> list[dict]:
    """A row for each number of modes; distances in metres."""
    rows = zip(*distances, strict=True)
    return [
        {
            "modes": int(modes),
            "distance": rounded(distance),
            "standard_error": rounded(error),
            "share": rounded(share),
        }
        for modes, distance, share, error in rows
    ]


def length_change(mean: np.ndarray, shapes: np.ndarray, faces: np.ndarray) -> float:
    """How far edges of the mean are from the mean length of those of the shapes."""
    ends = edges(faces).ends
    length = lambda points: np.linalg.norm(
        points[ends[:, 0]] - points[ends[:, 1]], axis=1
    )
    usual = np.mean([length(shape) for shape in shapes], 0)
    return rounded(np.abs(length(mean) / usual - 1).mean())


def rounded(value) -> float:
    """To four significant digits."""
    return float(f"{float(value):.4g}")


if __name__ == "__main__":
    main()
