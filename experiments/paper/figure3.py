"""Figures 3 and 4 of Pai et al. (CVPR 2021): iterations.

Error and spectral chamfer distance after each iteration of ICP and ZoomOut, with
nearest neighbour and with Sinkhorn, from the start of Table 2; and the error of one
conversion against its number of Sinkhorn updates, plain and over-relaxed. Means over
the pairs. Shapes in one connectivity (--data of registrations) give the regular case,
others the remeshed one.

    python -m experiments.paper.figure3 \\
        --embedded --out experiments/results/figure3.json
"""

from functools import partial
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets
from experiments.paper import compare, table2
from jfsf.apps.plot._charts import Panel, draw_curves
from jfsf.convert import nearest, sinkhorn
from jfsf.evaluate import geodesic_error, spectral_chamfer
from jfsf.refine import icp, zoomout
from jfsf.spectral import embeddings, functional_map

CONVERTERS = {"NN": nearest, "Sinkhorn": sinkhorn}
ROUNDS = 10  # of ICP
UPDATES = (1, 2, 3, 5, 8, 12, 20, 40, 80)
RELAX = {"plain": 1.0, "over-relaxed": 1.7}
K = 50  # of the conversion whose updates are counted


def main() -> None:
    parser = command_line.parser(__doc__, out="figure3.json")
    datasets.add_arguments(parser)
    parser.add_argument("--every", type=int, default=20, help="points: 1 in N")
    args = command_line.parse(parser)
    datasets.check_arguments(parser, args)
    pairs, found = datasets.pairs(args), []
    for names in pairs:
        pair = compare.load_pair(args, names, table2.K)
        start = table2.start_of(args, names, pair)
        curves = {**_refined(start, args.every), **_updates(pair, args.every)}
        found.append(curves)
        print(*names, {name: round(c["error"][-1], 4) for name, c in curves.items()})
    means = {
        name: {m: np.mean([c[name][m] for c in found], 0).tolist() for m in curve}
        for name, curve in found[0].items()
    }
    settings = {"ks": table2.KS, "icp": table2.K_ICP, "updates": UPDATES, "k": K}
    results_file.write(args.out, settings=settings, pairs=pairs, means=means)
    draw(means, args.out.with_suffix(".png"))


def _refined(start: table2.Start, every: int) -> dict:
    specs, curves = start.specs, {}
    for name, converter in CONVERTERS.items():
        C_yx, rounds = start.C_yx(table2.K_ICP), []
        for _ in range(ROUNDS):
            C_yx = icp(*specs, C_yx, num_iters=1, converter=converter, space="direct")
            rounds.append(_score(start, C_yx, converter, every))
        curves[f"ICP ({name})"] = _columns(rounds)
        C_yx, rounds = start.C_yx(table2.KS[0]), []
        for step in zip(table2.KS[:-1], table2.KS[1:], strict=True):
            C_yx = zoomout(*specs, C_yx, ks=step, converter=converter)
            rounds.append(_score(start, C_yx, converter, every))
        curves[f"ZoomOut ({name})"] = _columns(rounds)
    return curves


def _score(start: table2.Start, C_yx, converter, every: int):
    pair = start.pair
    T_xy = table2.convert(start, C_yx, converter).T_xy
    # Of one size throughout: the distance grows with the basis.
    C_yx = functional_map(T_xy, *pair[2:])
    emb = embeddings(C_yx, pair.spec_x.evecs, pair.spec_y.evecs)
    return _error(pair, T_xy, every), float(spectral_chamfer(*emb))


def _updates(pair: compare.Pair, every: int) -> dict:
    C_yx = compare.true_functional_map(pair)[:K, :K]
    emb = embeddings(C_yx, pair.spec_x.evecs, pair.spec_y.evecs)
    convert = partial(sinkhorn, *emb)
    found = {"NN": [_error(pair, nearest(*emb).T_xy, every)] * len(UPDATES)}
    for name, relax in RELAX.items():
        maps = (convert(num_iters=n, relax=jnp.float32(relax)) for n in UPDATES)
        found[name] = [_error(pair, m.T_xy, every) for m in maps]
    return {f"updates ({name})": {"error": values} for name, values in found.items()}


def _error(pair: compare.Pair, T_xy, every: int) -> float:
    truth = pair.x.truth[::every], pair.y.truth[::every]
    return float(geodesic_error(np.asarray(T_xy), pair.y.mesh, *truth).mean())


def _columns(rounds) -> dict[str, list[float]]:
    error, chamfer = zip(*rounds, strict=True)
    return {"error": list(error), "chamfer": list(chamfer)}


def draw(means: dict, path: Path) -> None:
    """Error and chamfer distance by iteration; error by updates."""
    rounds = {n: c for n, c in means.items() if not n.startswith("updates")}
    updates = {n[9:-1]: c["error"] for n, c in means.items() if n not in rounds}

    def by_round(metric):
        rows = {name: curve[metric] for name, curve in rounds.items()}
        return {name: (np.arange(1, len(row) + 1), row) for name, row in rows.items()}

    error = "mean geodesic error / sqrt(area)"
    by_update = {name: (UPDATES, row) for name, row in updates.items()}
    panels = [
        Panel(by_round("error"), "iteration", error),
        Panel(by_round("chamfer"), "iteration", "spectral chamfer distance"),
        Panel(by_update, f"Sinkhorn updates, k = {K}", error, log="x"),
    ]
    draw_curves(panels, path=path)


if __name__ == "__main__":
    main()
