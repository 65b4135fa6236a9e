"""Sinkhorn to a tolerance on embedded pairs, and what its gradients cost.

The marginals are the vertices' masses, and the functional maps are those of the ground
truth. How small a marginal error any plan on the same neighbours could have follows
from a maximal flow. Gradients are those of a pulled-back function with respect to both
embeddings: implicit ones, by tol=, beside unrolled ones through the number of updates
that this took, in turns, with the memory that XLA sets aside for each program.

    python -m experiments.bench.bench_tolerance [--repeats 5] [--out RESULT.json]
"""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow

from experiments import command_line, results_file
from experiments.bench import bench_filter
from jfsf import data
from jfsf.convert import pull_back, sinkhorn
from jfsf.spectral import spectrum
from jfsf.types import Kernel

PAIRS = (
    ("man_walk", "man_up"),
    ("man_walk", "woman_up"),
    ("heavy_squat", "child_kick"),
)
KERNELS = ((20, 120.0), (100, 120.0), (100, 20.0))  # k0, lam
TOL, K = 1e-3, 100
LAM, TOLS = 20.0, (0.1, 0.04, 0.03, 0.02, 0.01, 0.001)  # for gradients
MASS = 10**7  # of all vertices, in whole numbers


def main() -> None:
    parser = command_line.parser("Sinkhorn to a tolerance.", out="bench_tolerance.json")
    parser.add_argument("--repeats", type=int, default=5)
    args = command_line.parse(parser)
    rows = [row for x, y in PAIRS for row in solved(x, y)]
    settings = {"tol": TOL, "k": K, "dtype": "float32", "repeats": args.repeats}
    costs = gradients(args.repeats)
    results_file.write(args.out, settings=settings, pairs=rows, gradients=costs)


def solved(x: str, y: str):
    """Errors and numbers of updates of one pair."""
    emb_x, emb_y, mass_x, mass_y = embedded(x, y)
    for k0, lam in KERNELS:
        found = sinkhorn(emb_x, emb_y, mass_x, mass_y, lam=lam, k0=k0, tol=TOL)
        row = {
            "pair": f"{x} {y}",
            "k0": k0,
            "lam": lam,
            "marginal_error": float(found.marginal_error),
            "least_possible": least_error(found.kernel, mass_x, mass_y),
            "converged": bool(found.converged),
            "updates": int(found.num_iters),
        }
        print(*row.values(), flush=True)
        yield row


def embedded(x: str, y: str):
    """Aligned embeddings by the ground truth, and masses, in float32."""
    emb_x, emb_y, _ = bench_filter.embedded(K, x, y)
    masses = [spectrum(data.load(name).mesh, K).mass for name in (x, y)]
    return [jnp.asarray(a, jnp.float32) for a in (emb_x, emb_y, *masses)]


def least_error(kernel: Kernel, mass_x, mass_y) -> float:
    """The least marginal error of any plan on the kernel's entries."""
    n_x, n_y = len(mass_x), len(mass_y)
    at_x, slot_x = np.nonzero(np.isfinite(kernel.log_xy))
    at_y, slot_y = np.nonzero(np.isfinite(kernel.log_yx))
    rows = np.concatenate([at_x, np.asarray(kernel.idx_yx)[at_y, slot_y]])
    columns = np.concatenate([np.asarray(kernel.idx_xy)[at_x, slot_x], at_y])
    source, sink = n_x + n_y, n_x + n_y + 1
    supply, demand = (
        np.round(np.asarray(m, float) / np.sum(m, dtype=float) * MASS)
        for m in (mass_x, mass_y)
    )
    tails = np.concatenate([np.full(n_x, source), rows, n_x + np.arange(n_y)])
    heads = np.concatenate([np.arange(n_x), n_x + columns, np.full(n_y, sink)])
    most = np.concatenate([supply, np.full(len(rows), 10 * MASS), demand])
    graph = csr_array((most.astype(np.int32), (tails, heads)), shape=(sink + 1,) * 2)
    flow = maximum_flow(graph, source, sink).flow_value
    return max(float(supply.sum() + demand.sum() - 2 * flow) / MASS, 0.0)


def gradients(repeats: int) -> list[dict]:
    """Seconds and bytes of each way, on the first pair."""
    emb_x, emb_y, mass_x, mass_y = embedded(*PAIRS[0])

    def gradient(**options):
        def value(x, y):
            found = sinkhorn(x, y, mass_x, mass_y, lam=LAM, **options)
            return jnp.sum(jnp.sin(pull_back(found, emb_y[:, 1:2]))), found.num_iters

        slope = jax.jit(jax.value_and_grad(value, (0, 1), has_aux=True))
        return slope.lower(emb_x, emb_y).compile()

    table = []
    for tol in TOLS:
        implicit = gradient(tol=tol)
        updates = int(implicit(emb_x, emb_y)[0][1])
        ways = {"implicit": implicit, "unrolled": gradient(num_iters=updates)}
        runs = {
            name: lambda way=way: jax.block_until_ready(way(emb_x, emb_y))
            for name, way in ways.items()
        }
        times = bench_filter.interleave(runs, repeats)
        row: dict = {"tol": tol, "updates": updates}
        for name, way in ways.items():
            memory = way.memory_analysis()
            size = memory.temp_size_in_bytes if memory else None
            row[name] = {"seconds": times[name]["warm"], "bytes": size}
        print(*row.values(), flush=True)
        table.append(row)
    return table


if __name__ == "__main__":
    main()
