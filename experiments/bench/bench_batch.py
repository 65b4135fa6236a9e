"""Many pairs in one call against the loop over them, from spectra to maps.

Pairs of embedded shapes, simplified to some 1000 vertices of unequal number. All take
turns in one run, so that a busy moment slows all alike.

    python -m experiments.bench.bench_batch [--pairs 32] [--vertices 1000] \\
        [--out RESULT.json]
"""

from functools import partial
from itertools import permutations

import fast_simplification
import jax
import jax.numpy as jnp
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.bench.bench_filter import interleave
from jfsf import batch, data
from jfsf.convert import sinkhorn
from jfsf.initial import SearchSettings
from jfsf.runtime._sizes import common_size, padded_pair
from jfsf.spectral import embeddings
from jfsf.types import Maps, Mesh

LOOP = "loop"


def simplified(name: str, vertices: int) -> Mesh:
    """An embedded shape with about so many vertices."""
    mesh = data.load(name).mesh
    points, faces = fast_simplification.simplify(
        mesh.vertices.astype(np.float32), mesh.faces, target_count=2 * vertices, agg=3
    )[:2]
    return Mesh(points.astype(np.float64), faces.astype(np.int32))


def match_loop(xs, ys, settings):
    """One attempt a pair, pair by pair: what pairs without doubt need."""
    found = []
    for pair in zip(xs, ys, strict=True):
        one = jax.device_get(jfsf.match_spectra(*padded_pair(*pair), settings=settings))
        n_x, n_y = (len(spec.mass) for spec in pair)
        found.append(one._replace(T_xy=one.T_xy[:n_x], T_yx=one.T_yx[:n_y]))
    return found


def convert_loop(embs_x, embs_y):
    """`sinkhorn`, pair by pair, padded: else each pair of sizes is a program."""
    found = []
    for pair in zip(embs_x, embs_y, strict=True):
        padded, real = zip(*(_padded(emb) for emb in pair), strict=True)
        maps = jax.device_get(sinkhorn(*jax.device_put((*padded, *real))))
        n_x, n_y = map(len, pair)
        found.append(Maps(maps.T_xy[:n_x], maps.T_yx[:n_y]))
    return found


def _padded(emb):
    n = len(emb)
    size = common_size(n)
    return np.pad(emb, ((0, size - n), (0, 0))), np.float32((np.arange(size) < n) / n)


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_batch.json")
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--vertices", type=int, default=1000)
    parser.add_argument("--hypotheses", type=int, default=SearchSettings().hypotheses)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--batch-sizes", type=int, nargs="+", help="pairs vmapped at a time"
    )
    parser.add_argument(
        "--only", choices=("convert", "match"), help="one of the two contests"
    )
    args = command_line.parse(parser)
    names = data.names()
    # Shapes of unequal size, as files have; all of one padded size.
    specs = {
        name: jfsf.basis(simplified(name, args.vertices - 20 * i))
        for i, name in enumerate(names)
    }
    chosen = list(permutations(names, 2))
    chosen = [chosen[i % len(chosen)] for i in range(args.pairs)]
    xs, ys = ([specs[pair[side]] for pair in chosen] for side in (0, 1))
    sizes = sorted(len(spec.mass) for spec in specs.values())
    print(f"{args.pairs} pairs, {sizes[0]} to {sizes[-1]} vertices")

    batch_sizes = args.batch_sizes or [1, args.pairs]
    match_settings = jfsf.Settings(search=SearchSettings(hypotheses=args.hypotheses))
    contests = {}
    if args.only != "match":
        eye = jnp.eye(100, dtype=jnp.float32)
        pairs = [
            jax.device_get(
                embeddings(eye, *(spec.evecs.astype(np.float32) for spec in p))
            )
            for p in zip(xs, ys, strict=True)
        ]
        embs = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        run = partial(batch.convert, *embs, pairs=args.pairs)
        contests["convert"] = {
            LOOP: partial(convert_loop, *embs),
            **{f"batch, {b} vmapped": partial(run, batch_size=b) for b in batch_sizes},
        }
    if args.only != "convert":
        run = partial(
            batch.match_spectra, xs, ys, pairs=args.pairs, settings=match_settings
        )
        contests["match"] = {
            LOOP: partial(match_loop, xs, ys, match_settings),
            **{f"batch, {b} vmapped": partial(run, batch_size=b) for b in batch_sizes},
        }
    rows = {}
    for contest, contestants in contests.items():
        found = interleave(contestants, args.repeats)
        wanted = contestants[LOOP]()
        for name, row in found.items():
            row["warm_a_pair"] = row["warm"] / args.pairs
            row["loop_over_this"] = found[LOOP]["warm"] / row["warm"]
            row["same_as_loop"] = _alike(contestants[name](), wanted)
            print(
                f"{contest:8s} {name:20s} {row['warm_a_pair']:.4f} s a pair warm, cold "
                f"{row['cold']:.1f} s, loop takes {row['loop_over_this']:.2f} x that, "
                f"{row['same_as_loop']:.1%} of the vertices as the loop"
            )
        rows[contest] = found
    settings = {
        "pairs": args.pairs,
        "vertices": [sizes[0], sizes[-1]],
        "match_settings": match_settings.as_record(),
        "devices": len(jax.local_devices()),
        "repeats": args.repeats,
        "seed": None,
        "convert": "sinkhorn on 100 eigenfunctions, C_yx the identity",
        "match": "from the spectra on",
        "precision": "float32",
    }
    results_file.write(args.out, settings=settings, rows=rows)


def _alike(found, wanted) -> float:
    return float(
        np.mean(
            [
                (one.T_xy == two.T_xy).mean()
                for one, two in zip(found, wanted, strict=True)
            ]
        )
    )


if __name__ == "__main__":
    main()
