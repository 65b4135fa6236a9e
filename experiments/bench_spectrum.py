"""Seconds of a spectrum, against plain `scipy.sparse.linalg.eigsh`, in one run.

Both build the operators of an embedded shape and find its first k eigenpairs by
shift-invert Lanczos, without the cache. `jfsf.spectral.spectrum` checks the mesh,
orders the factor by minimum degree, and makes the problem symmetric first; the rival is
`eigsh(stiffness, k, M=mass, sigma=...)`. Both take turns, so that a busy moment slows
both alike.

    python experiments/bench_spectrum.py [--k 100 200] [--out RESULT.json]
"""

import argparse
from pathlib import Path

import numpy as np
import results_file
import scipy.sparse as sp
from bench_filter import interleave
from scipy.sparse.linalg import eigsh

from jfsf import data
from jfsf.mesh import surface_area
from jfsf.spectral import operators, spectrum
from jfsf.types import Mesh

OURS, RIVAL = "jfsf spectrum", "plain eigsh"
SHIFT = -0.01  # as ours, on the shape of area 1


def plain(mesh: Mesh, k: int) -> np.ndarray:
    """The first k eigenvalues at area 1, by `eigsh` as it comes."""
    stiffness, mass = operators(mesh)
    mass = sp.diags(mass / surface_area(mesh)).tocsc()
    start = np.random.default_rng(0).normal(size=len(mesh.vertices))
    return np.sort(eigsh(stiffness.tocsc(), k, M=mass, sigma=SHIFT, v0=start)[0])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shape", default="man_walk", help="an embedded shape")
    parser.add_argument("--k", type=int, nargs="+", default=[100, 200])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(__file__).parent / "results/bench_spectrum.json",
    )
    args = parser.parse_args()
    mesh = data.load(args.shape).mesh
    rows = {}
    for k in args.k:
        contestants = {
            OURS: lambda k=k: spectrum(mesh, k, cache=False).evals,
            RIVAL: lambda k=k: plain(mesh, k),
        }
        found = interleave(contestants, args.repeats)
        ours, theirs = (run() for run in contestants.values())
        gap = float(np.abs(ours - theirs).max() / theirs[-1])
        for name, row in found.items():
            row["over_ours"] = row["warm"] / found[OURS]["warm"]
            print(
                f"k = {k}: {name:14s} {row['warm']:.3f} s ({row['fastest']:.3f} to "
                f"{row['slowest']:.3f}), {row['over_ours']:.2f} x ours"
            )
        print(f"k = {k}: eigenvalues differ by {gap:.1e} of the largest")
        rows[str(k)] = {**found, "eigenvalues_differ": gap}
    settings = {
        "shape": args.shape,
        "vertices": len(mesh.vertices),
        "k": args.k,
        "repeats": args.repeats,
        "seed": 0,
        "seconds": "medians of the repeats; cold is the first call",
        "precision": "float64",
    }
    results_file.write(args.out, settings=settings, rows=rows)


if __name__ == "__main__":
    main()
