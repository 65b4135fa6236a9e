"""Learn which descriptors to trust, by gradient descent through the whole method.

A fit to descriptors, four soft steps of ZoomOut and the filter are one differentiable
function of the weights of the descriptors and of the fit's terms. These are learned on
twelve pairs of embedded shapes of some people, and tried on all pairs of other people.

    python -m experiments.accuracy.learn --out experiments/results/learn.json
"""

import time
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int

import jfsf
from experiments import command_line, results_file
from jfsf.apps.plot._charts import Panel, draw_curves
from jfsf.apps.plot._pictures import draw_maps
from jfsf.convert import pull_back, sinkhorn
from jfsf.data import load, names
from jfsf.evaluate import evaluate
from jfsf.initial import Weights
from jfsf.initial._linear import solve
from jfsf.initial._terms import ShapeTerms, combine, shape_terms
from jfsf.refine import soft_map, soft_zoomout_step
from jfsf.runtime._sizes import pad
from jfsf.spectral import embeddings, farthest_points, features, restrict
from jfsf.types import Maps, Spectrum

SIZE = 5120  # all shapes are padded to so many vertices: one compilation
SAMPLES = 500
FIT_SIZE = 30
KS = (16, 18, 22, 26, 30)  # the fit is cut to the first
# Softer than the default: a plan that is nearly a map has no slope.
soft_filter = partial(sinkhorn, k0=20, lam=5.0, num_iters=12, relax=1.0)


class Shape(NamedTuple):
    """spec: padded.

    terms: what a fit reads of it.
    samples: its spectrum at the samples.
    templates: the template point that each sample stands for, -1 without one.
    points: coordinates of the samples; their distances are biharmonic ones, of mean
        square 1.
    of_template: such coordinates of each template point.
    """

    spec: Spectrum
    terms: ShapeTerms
    samples: Spectrum
    templates: Int[Array, " s"]
    points: Float[Array, "s c"]
    of_template: Float[Array, "t c"]


class Parameters(NamedTuple):
    """Logarithms of the weights of the descriptors and of the terms of the fit."""

    columns: Float[Array, " d"]
    terms: Float[Array, " 4"]


def main() -> None:
    parser = command_line.parser(__doc__, out="learn.json")
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--rate", type=float, default=0.1)
    parser.add_argument("--people", nargs="+", default=["man", "child"])
    parser.add_argument("--pairs", type=int, default=12, help="to learn from")
    parser.add_argument("--every", type=int, default=20, help="template points: 1 in N")
    parser.add_argument("--seed", type=int, default=0)
    args = command_line.parse(parser)
    start = time.perf_counter()
    shapes = {name: _shape(name) for name in names()}
    of_people = [n for n in names() if n.split("_")[0] in args.people]
    seen = list(permutations(of_people, 2))
    order = np.random.default_rng(args.seed).permutation(len(seen))
    seen = [seen[i] for i in order[: args.pairs]]
    held_out = list(permutations([n for n in names() if n not in of_people], 2))

    number = len(shapes[held_out[0][0]].terms.mean)
    before = Parameters(jnp.zeros(number), jnp.log(jnp.asarray(Weights())))
    pairs = [(shapes[x], shapes[y]) for x, y in seen]
    after, curve = _learn(before, pairs, rate=args.rate, steps=args.steps)
    maps = [_maps(parameters, shapes, held_out) for parameters in (before, after)]
    errors = np.array([_errors(of, held_out, every=args.every) for of in maps])
    summary = {
        "mean": errors.mean(1).round(4).tolist(),
        "median": np.median(errors, axis=1).round(4).tolist(),
        "relative_change": round(float(errors[1].mean() / errors[0].mean() - 1), 3),
        "better": int((errors[1] < errors[0]).sum()),
    }
    print(summary)
    weights = zip(Weights._fields, jnp.exp(after.terms).tolist(), strict=True)
    results_file.write(
        args.out,
        settings={k: v for k, v in vars(args).items() if k != "out"},
        summary=summary,
        weights=dict(weights),
        column_weights=jnp.exp(after.columns).tolist(),
        loss=curve,
        pairs={"seen": seen, "held_out": held_out},
        errors={"before": errors[0].tolist(), "after": errors[1].tolist()},
        seconds=round(time.perf_counter() - start, 1),
    )
    _draw_errors(args.out.with_suffix(".png"), curve, errors)
    most = int(np.argmax(errors[0] - errors[1]))
    path = args.out.with_name(args.out.stem + "_maps.png")
    _draw_maps(path, held_out[most], [of[most] for of in maps], errors[:, most])


def _shape(name: str) -> Shape:
    mesh, truth = load(name)
    spec = pad(jfsf.spectrum(mesh, 120), SIZE, 2 * SIZE)
    template = np.full(SIZE, -1)
    template[truth] = np.arange(len(truth))
    return _prepared(jax.device_put(spec), jnp.asarray(truth), jnp.asarray(template))


@jax.jit
def _prepared(spec: Spectrum, truth: Int[Array, " t"], template: Int[Array, " n"]):
    found = features(spec)
    columns = jnp.concatenate([found.descriptors, found.curvature], 1)
    chosen = farthest_points(spec, num=SAMPLES)
    points = spec.evecs[:, 1:40] / spec.evals[None, 1:40]
    points = points / jnp.sqrt(2 * jnp.sum(spec.mass @ points**2))
    return Shape(
        spec,
        shape_terms(spec, columns, k=FIT_SIZE),
        restrict(spec, chosen),
        template[chosen],
        points[chosen],
        points[truth],
    )


def _steps(parameters: Parameters, x: Shape, y: Shape) -> list[Array]:
    """The functional map of the fit, and after each soft step of ZoomOut."""
    weights = Weights(*jnp.exp(parameters.terms))
    problem = combine(x.terms, y.terms, weights, jnp.exp(parameters.columns))
    C_yx = solve(problem).C_yx
    found = [C_yx, C_yx[: KS[0], : KS[0]]]
    for k in KS[1:]:
        step = partial(soft_zoomout_step, k=k, converter=soft_filter)
        found.append(step(x.samples, y.samples, found[-1]))
    return found


def _loss(parameters: Parameters, x: Shape, y: Shape) -> Array:
    """Mean distance to the true point under the soft map, over all steps."""
    known = x.templates >= 0
    true = y.of_template[x.templates]

    def distance(C_yx):
        plan = soft_map(x.samples, y.samples, C_yx, converter=soft_filter)
        square = jnp.sum((pull_back(plan, y.points) - true) ** 2, 1)
        return jnp.sum(jnp.where(known, jnp.sqrt(square + 1e-4), 0)) / jnp.sum(known)

    return jnp.mean(jnp.stack([distance(C) for C in _steps(parameters, x, y)]))


def _learn(parameters: Parameters, pairs, *, rate: float, steps: int):
    """Adam on the mean loss of the pairs; each pair's gradient is cut to one length."""
    slope = jax.jit(jax.value_and_grad(_loss))
    optimiser = optax.adam(rate)
    state, curve = optimiser.init(parameters), []
    for number in range(steps):
        losses, total = [], jax.tree.map(jnp.zeros_like, parameters)
        for x, y in pairs:
            loss, gradient = slope(parameters, x, y)
            losses.append(float(loss))
            # Near a pair's change of sides the slope is steep, and says little.
            cut = 1 / jnp.maximum(optax.global_norm(gradient), 0.02)
            total = jax.tree.map(lambda t, g, c=cut: t + c * g, total, gradient)
        update, state = optimiser.update(total, state)
        parameters = jax.tree.map(jnp.add, parameters, update)
        curve.append(float(np.mean(losses)))
        print(f"{number + 1:3d}/{steps} loss {curve[-1]:.4f}", flush=True)
    return parameters, curve


def _maps(parameters: Parameters, shapes: dict[str, Shape], pairs) -> list[Maps]:
    return [_map(parameters, shapes[x], shapes[y]) for x, y in pairs]


@jax.jit
def _map(parameters: Parameters, x: Shape, y: Shape) -> Maps:
    """The filter's maps of all vertices, with the default kernel."""
    C_yx = _steps(parameters, x, y)[-1]
    embs = embeddings(C_yx, x.spec.evecs, y.spec.evecs, space="direct")
    a, b = ((s.spec.mass > 0) / jnp.sum(s.spec.mass > 0) for s in (x, y))
    found = sinkhorn(*embs, a, b)
    return Maps(found.T_xy, found.T_yx)


def _errors(maps: list[Maps], pairs, *, every: int) -> list[float]:
    """Mean geodesic error / sqrt(area of Y), of each pair."""
    errors = []
    for (T_xy, T_yx), (x, y) in zip(maps, pairs, strict=True):
        (mesh_x, truth_x), (mesh_y, truth_y) = load(x), load(y)
        cut = Maps(T_xy[: len(mesh_x.vertices)], T_yx[: len(mesh_y.vertices)])
        options = {"every": every, "only": ("error",)}
        found = evaluate(cut, mesh_x, mesh_y, truth=(truth_x, truth_y), **options)
        errors.append(float(found.error_mean))
    return errors


def _draw_errors(path: Path, curve: list[float], errors: np.ndarray) -> None:
    order = np.argsort(errors[0])
    pairs = np.arange(1, len(order) + 1)
    held_out = {
        f"{label} (mean {np.mean(values):.3f})": (pairs, values[order])
        for label, values in zip(("equal", "learned"), errors, strict=True)
    }
    steps = {"": (np.arange(1, len(curve) + 1), curve)}
    loss = Panel(steps, "step", "loss on the pairs learned from")
    draw_curves([loss, Panel(held_out, "held-out pair", "mean error")], path=path)


def _draw_maps(path: Path, pair, maps: list[Maps], errors: np.ndarray) -> None:
    """The held-out pair that gains most."""
    (mesh_x, _), (mesh_y, _) = (load(name) for name in pair)
    drawn = {
        f"{label}: {error:.3f}": np.asarray(m.T_xy)[: len(mesh_x.vertices)]
        for label, m, error in zip(("equal", "learned"), maps, errors, strict=True)
    }
    draw_maps(mesh_x, mesh_y, drawn, path=path, title="{} to {}".format(*pair))


if __name__ == "__main__":
    main()
