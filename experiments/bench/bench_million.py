"""A map between two meshes of a million vertices, step by step: seconds and memory.

The steps of `jfsf.match` for large meshes, by its own stages (`jfsf.matching`): spectra
one after the other, features, search and ZoomOut on samples, a conversion in full, and,
as the last refinement, the bending of both shapes and another conversion. Embedded
shapes, upsampled (`upsample.py`). Every step runs once, so it compiles too. Memory is
the most that the process has had so far. Errors are Euclidean, over sqrt(area), at the
vertices of known partner.

    python -m experiments.bench.bench_million [--vertices 1000000] [--out RESULT.json]
"""

import gc
import resource
import time

import jax
import jax.numpy as jnp
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.bench.upsample import upsample
from jfsf import data
from jfsf.convert import sinkhorn
from jfsf.initial import search_starts
from jfsf.matching import shape_samples
from jfsf.matching._stages import deform_by_arap, pair_search
from jfsf.matching._steps import refine_start
from jfsf.spectral import embeddings, truncate_pair, uniform


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
    parser = command_line.parser(__doc__, out="bench_million.json")
    parser.add_argument("--x", default="man_walk")
    parser.add_argument("--y", default="man_up")
    parser.add_argument("--vertices", type=int, default=1_000_000)
    args = command_line.parse(parser)
    samples = [data.load(name) for name in (args.x, args.y)]
    gt_x, gt_y = (sample.template_to_vertex for sample in samples)
    step = Steps()

    meshes = [upsample(sample.mesh, args.vertices) for sample in samples]
    specs = [
        step(f"spectrum of {name}", lambda mesh=mesh: jfsf.basis(mesh, cache=False))
        for name, mesh in zip("XY", meshes, strict=True)
    ]
    del meshes
    spec_x, spec_y = jax.tree.map(jnp.asarray, truncate_pair(*specs))
    del specs
    place = np.asarray(spec_y.vertices)

    def error(maps) -> float:
        apart = place[np.asarray(maps.T_xy)[gt_x]] - place[gt_y]
        return float(np.linalg.norm(apart, axis=1).mean())

    pair = spec_x, spec_y
    settings = jfsf.Settings()
    x, y = step("features and samples", lambda: tuple(map(shape_samples, pair)))
    start = step("search on samples", lambda: search_starts(x.search, y.search)[0])
    features = x.refinement, y.refinement
    C_yx = step("ZoomOut on samples", lambda: refine_start(features, start))
    search = step("tiles", lambda: pair_search(*pair, settings=settings))
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)

    def converted(emb_x, emb_y, *_):
        return sinkhorn(emb_x, emb_y, *marginals, search)

    embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    maps = step("Sinkhorn in full, both ways", lambda: converted(*embs))
    # `match` compares all points if the recall among tiles is low, but not so many.
    errors, recall = {"converted": error(maps)}, float(maps.recall)

    def deformed():
        return deform_by_arap(*pair, C_yx, start.sign, search, settings=settings)

    aligned = step("bending", deformed)
    maps = step("Sinkhorn again", lambda: converted(*aligned))
    errors["bent"] = error(maps)
    print({name: round(value, 4) for name, value in errors.items()}, "recall", recall)
    record = {
        "x": args.x,
        "y": args.y,
        "vertices": args.vertices,
        "eigenpairs": len(spec_x.evals),
        "match_settings": settings.as_record(),
        "seed": None,
    }
    results_file.write(
        args.out, settings=record, steps=step.rows, errors=errors, recall=recall
    )


if __name__ == "__main__":
    main()
