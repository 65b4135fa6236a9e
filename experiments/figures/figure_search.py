"""Candidates of the search for the initial map: Y, and X in the colours of each.

The label of a candidate has its energy and orientation score. With orientation "any",
mirrored candidates rank among the others.

    python -m experiments.figures.figure_search \\
        --out experiments/results/figure_search.png
"""

import jax
import jax.numpy as jnp
import numpy as np

import jfsf
from experiments import command_line, results_file
from jfsf.apps.plot._pictures import draw_maps
from jfsf.convert import nearest
from jfsf.data import load
from jfsf.evaluate import geodesic_error
from jfsf.initial import search
from jfsf.spectral import embeddings, truncate_pair


def main() -> None:
    parser = command_line.parser(__doc__, out="figure_search.png")
    parser.add_argument("--x", default="man_walk")
    parser.add_argument("--y", default="man_up")
    parser.add_argument("--show", type=int, default=4, help="candidates to draw")
    args = command_line.parse(parser)

    (mesh_x, gt_x), (mesh_y, gt_y) = load(args.x), load(args.y)
    specs = truncate_pair(*map(jfsf.basis, (mesh_x, mesh_y)))
    spec_x, spec_y = jax.tree.map(jnp.asarray, specs)
    found = search(spec_x, spec_y, sign=0, num=args.show)

    maps, rows = {}, []
    some = slice(None, None, 20)
    fields = found.C_yx, found.energy, found.orientation
    for C_yx, energy, orientation in zip(*fields, strict=True):
        if not np.isfinite(energy):
            continue  # a copy of a better one
        embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
        T_xy = np.asarray(nearest(*embs).T_xy)
        error = geodesic_error(T_xy, mesh_y, gt_x[some], gt_y[some]).mean()
        row = {
            "energy": float(energy),
            "orientation": float(orientation),
            "error": float(error),
        }
        rows.append(row)
        maps[f"energy {energy:.2f}, orientation {orientation:+.2f}"] = T_xy
    draw_maps(mesh_x, mesh_y, maps, path=args.out)

    settings = {"x": args.x, "y": args.y, "show": args.show}
    settings["match_settings"] = jfsf.Settings().as_record()
    results_file.write(args.out.with_suffix(".json"), settings=settings, rows=rows)
    print(*rows, sep="\n")


if __name__ == "__main__":
    main()
