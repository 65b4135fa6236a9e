"""A map between two meshes of a million vertices, step by step: seconds and memory.

What `jfsf.match` does with large meshes, from its parts: spectra one after the other,
the search and ZoomOut on samples, one conversion in full, and, as the last refinement,
the bending of both shapes. Embedded shapes, upsampled (`upsample.py`). Every step runs
once, so it compiles too. Memory is the most that the process has had so far. Errors are
Euclidean, over sqrt(area), at the vertices of known partner.

    python experiments/bench_million.py [--vertices 1000000] [--out RESULT.json]
"""

import argparse
import gc
import resource
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import results_file
from upsample import upsample

from jfsf import data
from jfsf.candidates import tiled_neighbours
from jfsf.convert import brief, brief_nearest, sinkhorn
from jfsf.descriptors import wks
from jfsf.fmap import embeddings, uniform
from jfsf.match import basis, common
from jfsf.pipeline import EVERY, KS, REFINED
from jfsf.refine import arap, zoomout
from jfsf.sampling import restrict, tile_points
from jfsf.search import search
from jfsf.tiles import spectral_tiles


class Steps:
    """What was done, how long it took, and the most memory by then."""

    def __init__(self):
        self.rows: list[dict] = []

    def __call__(self, name: str, run):
        start = time.perf_counter()
        found = jax.block_until_ready(run())
        seconds = time.perf_counter() - start
        gc.collect()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        self.rows.append({"step": name, "seconds": seconds, "peak_gb": peak})
        print(f"{name:32s} {seconds:7.1f} s, {peak:5.1f} GB", flush=True)
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--x", default="man_walk")
    parser.add_argument("--y", default="man_up")
    parser.add_argument("--vertices", type=int, default=1_000_000)
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "results/bench_million.json"
    )
    args = parser.parse_args()
    samples = [data.load(name) for name in (args.x, args.y)]
    gt_x, gt_y = (sample.template_to_vertex for sample in samples)
    step = Steps()

    meshes = [upsample(sample.mesh, args.vertices) for sample in samples]
    specs = [
        step(f"spectrum of {name}", lambda mesh=mesh: basis(mesh, cache=False))
        for name, mesh in zip("XY", meshes, strict=True)
    ]
    del meshes
    spec_x, spec_y = jax.tree.map(jnp.asarray, common(*specs))
    del specs
    place = np.asarray(spec_y.vertices)

    def error(maps) -> float:
        apart = place[np.asarray(maps.T_xy)[gt_x]] - place[gt_y]
        return float(np.linalg.norm(apart, axis=1).mean())

    descs = (wks(spec)[:, ::EVERY] for spec in (spec_x, spec_y))
    found = step("search on samples", lambda: search(spec_x, spec_y, *descs))

    def refined():
        small = [restrict(s, tile_points(s, num=REFINED)) for s in (spec_x, spec_y)]
        few = tuple(map(spectral_tiles, small))
        start = found.C_yx[0]
        return zoomout(*small, start, ks=KS, converter=brief, tiles=few)

    C_yx = step("ZoomOut on samples", refined)
    tiles = step("tiles", lambda: (spectral_tiles(spec_x), spectral_tiles(spec_y)))
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)

    def converted():
        embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
        return sinkhorn(*embs, *marginals, tiles=tiles, least=0.0)

    maps = step("Sinkhorn in full, both ways", converted)
    errors = {"converted": error(maps)}

    def searched():
        embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
        return tiled_neighbours(*embs, *tiles, k0=1, least=0.0).recall

    # What decides whether `match` would compare all points with all.
    recall = float(step("recall of a sample", searched))

    def bent():
        embs = arap(spec_x, spec_y, maps, converter=brief_nearest, tiles=tiles)
        return sinkhorn(*embs, *marginals, tiles=tiles, least=0.0)

    maps = step("bending, and Sinkhorn again", bent)
    errors["bent"] = error(maps)
    print({name: round(value, 4) for name, value in errors.items()}, "recall", recall)
    settings = {
        "x": args.x,
        "y": args.y,
        "vertices": args.vertices,
        "eigenpairs": len(spec_x.evals),
        "seed": None,
    }
    results_file.write(
        args.out, settings=settings, steps=step.rows, errors=errors, recall=recall
    )


if __name__ == "__main__":
    main()
