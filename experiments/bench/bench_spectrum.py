"""Seconds of a spectrum, against plain `scipy.sparse.linalg.eigsh`, in one run.

Both build the operators of an embedded shape, of its own size and with its edges split
until it is larger, and find the first k eigenpairs by shift-invert Lanczos, without the
cache. `jfsf.spectral.spectrum` checks the mesh first. The rival is
`eigsh(stiffness, k, M=mass, sigma=...)` to the last digit, for the smaller sizes. Both
take turns, so that a busy moment slows both alike.

    python -m experiments.bench.bench_spectrum [--vertices 100000] [--out RESULT.json]
"""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from experiments import command_line, results_file
from experiments.bench.bench_filter import interleave
from experiments.bench.upsample import upsample
from jfsf import data
from jfsf.mesh import surface_area
from jfsf.spectral import spectrum
from jfsf.spectral._laplacian import operators
from jfsf.types import Mesh

OURS, RIVAL = "jfsf spectrum", "plain eigsh"
SHIFT = -0.01  # on the shape of area 1
RIVAL_UP_TO = 200_000  # vertices; above, it takes many minutes


def plain(mesh: Mesh, k: int) -> np.ndarray:
    """The first k eigenvalues at area 1, by `eigsh` as it comes."""
    stiffness, mass = operators(mesh)
    mass = sp.diags(mass / surface_area(mesh)).tocsc()
    start = np.random.default_rng(0).normal(size=len(mesh.vertices))
    return np.sort(eigsh(stiffness.tocsc(), k, M=mass, sigma=SHIFT, v0=start)[0])


def main() -> None:
    parser = command_line.parser(__doc__, out="bench_spectrum.json")
    parser.add_argument("--shape", default="man_walk", help="an embedded shape")
    parser.add_argument("--k", type=int, default=128)
    parser.add_argument("--vertices", type=int, nargs="*", default=[100_000])
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    mesh = data.load(args.shape).mesh
    rows = {}
    for n in (len(mesh.vertices), *args.vertices):
        large = upsample(mesh, n)
        contestants: dict[str, Callable] = {
            OURS: lambda m=large: spectrum(m, args.k, cache=False).evals
        }
        if n <= RIVAL_UP_TO:
            contestants[RIVAL] = lambda m=large: plain(m, args.k)
        found = interleave(contestants, args.repeats)
        for name, row in found.items():
            row["over_ours"] = row["warm"] / found[OURS]["warm"]
            print(
                f"n = {n}: {name:14s} {row['warm']:.3f} s ({row['fastest']:.3f} to "
                f"{row['slowest']:.3f}), {row['over_ours']:.2f} x ours",
                flush=True,
            )
        rows[str(n)] = found
        if RIVAL in contestants:
            ours, theirs = (run()[1:] for run in contestants.values())
            gap = float(np.abs(ours / theirs - 1).max())
            print(f"n = {n}: eigenvalues differ by {gap:.1e} at most", flush=True)
            rows[str(n)] = {**found, "eigenvalues_differ": gap}
    settings = {
        "shape": args.shape,
        "k": args.k,
        "repeats": args.repeats,
        "seed": 0,
        "seconds": "medians of the repeats; cold is the first call",
        "precision": "float64",
    }
    results_file.write(args.out, settings=settings, rows=rows)


if __name__ == "__main__":
    main()
