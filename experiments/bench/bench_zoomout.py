"""ZoomOut and the whole way from two meshes, against pyFM, in one run.

ZoomOut: 20 to 100 by 5 from one start, with the same spectra. Ours gives maps both
ways, with the Sinkhorn filter or with nearest neighbour, all points compared or those
of tiles. pyFM's gives a map one way, by nearest neighbour.
Whole: `jfsf.match` without its cache against the best pyFM recipe that we found: 150
eigenpairs, every fifth of 100 WKS, a 30 x 30 fit, ZoomOut 20 to 150 by 5.

Two embedded shapes, or two of a folder with ground truth (see datasets.py).

    python -m experiments.bench.bench_zoomout [--data FOLDER --x NAME --y NAME] \\
        [--out FILE]
"""

from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from pyFM.refine.zoomout import zoomout_refine

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets
from experiments.bench.bench_filter import EVERY, interleave
from experiments.bench.peer_recipes import pyfm
from jfsf.convert import nearest, sinkhorn
from jfsf.convert._variants import quick_sinkhorn
from jfsf.evaluate import geodesic_error
from jfsf.initial import search
from jfsf.mesh import orient
from jfsf.neighbours import NeighbourSearch, spectral_tiles
from jfsf.refine import zoomout
from jfsf.spectral import embeddings, spectrum, uniform

KS = tuple(range(20, 101, 5))


@partial(jax.jit, static_argnames=("inside", "last", "tiled"))
def ours(spec_x, spec_y, C_yx, inside, last, tiled):
    """Maps both ways at ks[-1]; tiles are made anew."""
    tiles = (spectral_tiles(spec_x), spectral_tiles(spec_y)) if tiled else None
    search = NeighbourSearch(tiles)
    quick = search.unchecked()
    C_yx = zoomout(spec_x, spec_y, C_yx, ks=KS, converter=inside, search=quick)
    embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    found = last(*embs, uniform(spec_x.mass), uniform(spec_y.mass), search)
    return found.T_xy, found.T_yx


def theirs(spec_x, spec_y, C_yx):
    """pyFM's map; its mesh 2 is our X."""
    _, T_xy = zoomout_refine(
        C_yx,
        spec_y.evecs,
        spec_x.evecs,
        nit=len(KS) - 1,
        step=KS[1] - KS[0],
        A2=spec_x.mass,
        return_p2p=True,
    )
    return T_xy, None


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_zoomout.json")
    parser.add_argument(
        "--data", type=Path, action="append", help="folder of meshes; else embedded"
    )
    parser.add_argument("--x", default="man_walk")
    parser.add_argument("--y", default="man_up")
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    args.embedded, args.pairs, args.within = args.data is None, None, None
    (mesh_x, gt_x, _), (mesh_y, gt_y, _) = (
        datasets.load(args, name) for name in (args.x, args.y)
    )
    sizes = [len(mesh.vertices) for mesh in (mesh_x, mesh_y)]
    print(f"{args.x} to {args.y}: {sizes[0]} and {sizes[1]} vertices")

    wide = [spectrum(orient(mesh), KS[-1]) for mesh in (mesh_x, mesh_y)]
    narrow = [
        spec._replace(
            **{
                name: jnp.asarray(getattr(spec, name), jnp.float32)
                for name in ("evals", "evecs", "mass")
            },
            faces=jnp.asarray(spec.faces),
        )
        for spec in wide
    ]
    candidates = search(narrow[0], narrow[1])
    start = candidates.C_yx[0, : KS[0], : KS[0]]
    start_wide = np.asarray(start, np.float64)

    finished = lambda *args: jax.block_until_ready(ours(*narrow, start, *args))
    zooms = {
        "jfsf zoomout, sinkhorn": partial(finished, quick_sinkhorn, sinkhorn, False),
        "jfsf zoomout, nearest": partial(finished, nearest, nearest, False),
        "jfsf tiled, sinkhorn": partial(finished, quick_sinkhorn, sinkhorn, True),
        "jfsf tiled, nearest": partial(finished, nearest, nearest, True),
        "pyFM zoomout": partial(theirs, *wide, start_wide),
    }
    wholes = {
        "jfsf match": lambda: jax.block_until_ready(
            jfsf.match(mesh_x, mesh_y, cache=False)
        ),
        "pyFM recipe": lambda: (pyfm(mesh_x, mesh_y), None),
    }
    rows = {}
    for contest, rival in ((zooms, "pyFM zoomout"), (wholes, "pyFM recipe")):
        found = interleave(contest, args.repeats)
        for name, row in found.items():
            row["rival_over_this"] = found[rival]["warm"] / row["warm"]
            T_xy = np.asarray(contest[name]()[0])
            some = gt_x[::EVERY], gt_y[::EVERY]
            row["error"] = float(geodesic_error(T_xy, mesh_y, *some).mean())
            print(
                f"{name:24s} warm {row['warm']:.3f} s ({row['fastest']:.3f} to "
                f"{row['slowest']:.3f}), cold {row['cold']:.2f} s, {rival} takes "
                f"{row['rival_over_this']:.2f} x that, error {row['error']:.4f}"
            )
        rows.update(found)
    settings = {
        "x": args.x,
        "y": args.y,
        "data": "folder" if args.data else "embedded",
        "vertices": sizes,
        "ks": KS,
        "match_settings": jfsf.Settings().as_record(),
        "start": "leading block of the best candidate of jfsf.initial.search",
        "directions": "jfsf both, pyFM one",
        "precision": "jfsf float32, pyFM float64",
        "repeats": args.repeats,
        "seed": None,
    }
    results_file.write(args.out, settings=settings, rows=rows)


if __name__ == "__main__":
    main()
