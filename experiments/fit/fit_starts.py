"""Do robust or orthogonal fits to descriptors make better starts than the linear one?

Each fit starts from the wave kernel signature, as the search's own fits do, and is
refined on samples to 20 functions. The error of the map there is that of the start.

    python -m experiments.fit.fit_starts --embedded --spread 24 --out RESULT.json
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets
from experiments.accuracy.protocol import RIGHT
from jfsf.convert import nearest
from jfsf.evaluate import evaluate
from jfsf.initial._fit import solve_nonlinear
from jfsf.initial._hypotheses import SamplePair, refine_hypotheses
from jfsf.initial._linear import solve
from jfsf.initial._samples import search_samples
from jfsf.initial._settings import FIT_KS
from jfsf.initial._settings import FITS as SEARCHED
from jfsf.initial._terms import combine
from jfsf.spectral import embeddings, features, spectrum

# Name, loss, scale, weight of orthogonality, steps at most.
FITS = (
    ("linear", None, 0.0, 0.0, 0),
    ("huber 0.3", "huber", 0.3, 0.0, 200),
    ("geman-mcclure 0.3", "geman-mcclure", 0.3, 0.0, 200),
    ("orthogonality 0.1", "square", 0.0, 0.1, 200),
    ("orthogonality 1", "square", 0.0, 1.0, 200),
    ("orthogonality 1, ten steps", "square", 0.0, 1.0, 10),
    ("geman-mcclure 0.3, orthogonality 0.1", "geman-mcclure", 0.3, 0.1, 200),
)


def main() -> None:
    parser = command_line.parser(__doc__)
    datasets.add_arguments(parser)
    parser.add_argument("--every", type=int, default=20, help="template points: 1 in N")
    args = command_line.parse(parser)
    datasets.check_arguments(parser, args)
    rows, samples = [], {}
    for x, y in datasets.pairs(args):
        shapes = datasets.load_pair(args, x, y)
        for name, shape in zip((x, y), shapes, strict=True):
            if name not in samples:
                samples[name] = _samples(shape.mesh)
        rows.append({"x": x, "y": y, **_errors(shapes, samples[x], samples[y], args)})
        shown = " ".join(f"{min(e):.3f}" for e in list(rows[-1].values())[2:])
        print(f"{len(rows):3d} {x} {y} {shown}", flush=True)
    summary = {name: _summary([row[name] for row in rows]) for name, *_ in FITS}
    for name, found in summary.items():
        print(name, found)
    if args.out:
        settings = {"right": RIGHT, "every": args.every, "fits": FITS}
        results_file.write(args.out, settings=settings, summary=summary, pairs=rows)


def _samples(mesh):
    spec = jax.device_put(spectrum(mesh, 120))
    return spec, search_samples(jax.jit(features)(spec))


@partial(jax.jit, static_argnames="fit")
def _fitted(x, y, *, fit):
    """The map of each of the search's weights by one kind of fit."""
    _, loss, scale, orthogonality, steps = fit
    found = []
    for weights in SEARCHED:
        problem = combine(x.fit, y.fit, weights)
        if loss is None:
            found.append(solve(problem).C_yx)
        else:
            options = {"loss": loss, "max_steps": steps}
            found.append(solve_nonlinear(problem, orthogonality, scale, **options).C_yx)
    size = FIT_KS[0]
    return jnp.stack(found)[:, :size, :size]


@jax.jit
def _refined(x, y, C_yx):
    pair = SamplePair(x.search_points, y.search_points, False)
    return refine_hypotheses(pair, C_yx, 1.0, ks=FIT_KS)


def _errors(shapes, x, y, args) -> dict:
    (spec_x, samples_x), (spec_y, samples_y) = x, y
    (mesh_x, gt_x, _), (mesh_y, gt_y, _) = shapes
    rows = {}
    for fit in FITS:
        errors, C_yx = [], _fitted(samples_x, samples_y, fit=fit)
        for C_refined in _refined(samples_x, samples_y, C_yx):
            embs = embeddings(C_refined, spec_x.evecs, spec_y.evecs, space="direct")
            options = {"every": args.every, "only": ("error",)}
            maps = nearest(*embs)
            found = evaluate(maps, mesh_x, mesh_y, truth=(gt_x, gt_y), **options)
            errors.append(float(found.error_mean))
        rows[fit[0]] = errors
    return rows


def _summary(errors: list[list[float]]) -> dict:
    """Of each weight's start, and of the better of both, as in a pool."""
    each, best = np.array(errors), np.min(errors, axis=1)
    return {
        "mean": each.mean(0).round(4).tolist(),
        "right": (each < RIGHT).sum(0).tolist(),
        "best_mean": round(float(best.mean()), 4),
        "best_right": int((best < RIGHT).sum()),
    }


if __name__ == "__main__":
    main()
