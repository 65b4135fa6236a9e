"""Shape models of the embedded bodies, from their true correspondence.

All twelve are put in the triangulation of one of them by the ground truth
(`datasets.posed`). Of them a model of positions and one of deformation gradients are
fitted, and measured as the field does (Davies 2002; Styner et al. 2003): compactness,
generality and specificity, by the number of modes, in metres, and as a `share` of
sqrt(area). `length_change` says what a model does to limbs: the mean over edges of how
far the mean shape's lengths are from the mean lengths, relative to these.

    python -m experiments.accuracy.shape_model
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from jfsf import data
from jfsf.apps import model
from jfsf.mesh._geometry import edges

FITS = {"positions": model.fit_model, "gradients": model.fit_gradient_model}
COUNTS = (0, 1, 2, 3, 5, 8, 10)  # numbers of modes


def main() -> None:
    parser = command_line.parser(__doc__, out="shape_model.json")
    parser.add_argument("--template", default="man_t", choices=data.names())
    parser.add_argument("--scale", action="store_true", help="take away sizes")
    parser.add_argument("--samples", type=int, default=50, help="of specificity")
    parser.add_argument("--seed", type=int, default=0)
    args = command_line.parse(parser)
    shapes, faces = in_one_mesh(args.template)
    angles = model.local_rotation(jnp.asarray(shapes), faces)
    settings = {
        "template": args.template,
        "scale": args.scale,
        "samples": args.samples,
        "seed": args.seed,
    }
    rows = {}
    for kind, fit in FITS.items():
        rows[kind] = measure(shapes, faces, partial(fit, scale=args.scale), args)
        print(kind, rows[kind], flush=True)
    results_file.write(
        args.out,
        settings=settings,
        shapes=list(data.names()),
        vertices=shapes.shape[1],
        local_rotation=listed(angles),
        warning=model.bending_warning(jnp.asarray(shapes), faces),
        models=rows,
    )


def in_one_mesh(template: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions (s, n, 3) of all embedded shapes, and the faces of the template."""
    embedded = protocol.SETS["embedded"]
    x = datasets.load_shape(embedded, template)
    own = [datasets.load_shape(embedded, name) for name in data.names()]
    shapes = np.stack([datasets.posed(x, y).mesh.vertices for y in own])
    return shapes, x.mesh.faces


def measure(shapes: np.ndarray, faces: np.ndarray, fit, args) -> dict:
    """The figures of one kind of model."""
    positions = jnp.asarray(shapes)
    fitted = fit(positions, faces)
    compact = model.compactness(fitted)
    general = model.generality(positions, faces, fit=fit, counts=COUNTS)
    special = model.specificity(
        *(fitted, positions, jax.random.key(args.seed)),
        samples=args.samples,
        counts=COUNTS[1:],
    )
    return {
        "compactness": listed(compact.share),
        "generality": table(general),
        "specificity": table(special),
        "length_change": length_change(np.asarray(fitted.mean), shapes, faces),
    }


def table(distances: model.Distances) -> list[dict]:
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


def listed(values) -> list[float]:
    """Rounded numbers."""
    return [rounded(value) for value in values]


def rounded(value) -> float:
    """To four significant digits."""
    return float(f"{float(value):.4g}")


if __name__ == "__main__":
    main()
