"""The rival of the benchmarks: the filter in numpy, scipy and scikit-learn, float64.

Reference settings (Pai et al., CVPR 2021, as their code runs): p = 1, k0 = 50, a lam of
500 / max d for each direction, half weights, uniform marginals, 11 updates of u.

    python -m experiments.bench.numpy_filter --data FOLDER
"""

import numpy as np
import scipy.sparse as sp
from sklearn.neighbors import NearestNeighbors

from experiments import command_line


def nearest(emb_x: np.ndarray, emb_y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """T_xy (n_x,) and T_yx (n_y,) by nearest neighbour."""
    return _near(emb_x, emb_y, 1)[1][:, 0], _near(emb_y, emb_x, 1)[1][:, 0]


def fast_sinkhorn(
    emb_x: np.ndarray,
    emb_y: np.ndarray,
    *,
    lam: float = 500.0,
    k0: int = 50,
    num_iters: int = 11,
) -> tuple[np.ndarray, np.ndarray]:
    """T_xy (n_x,) and T_yx (n_y,) by the Fast Sinkhorn Filter."""
    kernel_xy = _kernel(emb_x, emb_y, lam, k0)
    kernel_yx = _kernel(emb_y, emb_x, lam, k0)
    kernel = ((kernel_xy + kernel_yx.T) / 2).tocsr()
    flipped = kernel.T.tocsr()
    n_x, n_y = kernel.shape
    u, v = np.full(n_x, 1 / n_x), np.full(n_y, 1 / n_y)
    for _ in range(num_iters):
        v = 1 / n_y / (flipped @ u)
        u = 1 / n_x / (kernel @ v)
    # A positive factor a row does not move its argmax.
    T_xy = (kernel @ sp.diags(v)).tocsr().argmax(axis=1)
    T_yx = (flipped @ sp.diags(u)).tocsr().argmax(axis=1)
    return np.asarray(T_xy).ravel(), np.asarray(T_yx).ravel()


def _near(queries, points, k0):
    return NearestNeighbors(n_neighbors=k0).fit(points).kneighbors(queries)


def _kernel(queries, points, lam, k0) -> sp.csr_matrix:
    dist, idx = _near(queries, points, k0)
    weight = np.exp(-lam / dist.max() * dist)
    start = np.arange(0, weight.size + 1, k0)
    shape = len(queries), len(points)
    return sp.csr_matrix((weight.ravel(), idx.ravel(), start), shape)


def main() -> None:
    # Only the check needs jfsf, for the spectra.
    import authors_pair

    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("--ks", type=int, nargs="+", default=(50, 100))
    args = command_line.parse(parser)
    pair = authors_pair.load(args.data)
    truth = authors_pair.reference(args.data)
    for k in args.ks:
        emb_x, emb_y = authors_pair.embedded(pair, k)
        for name, convert in (("nn", nearest), ("sinkhorn", fast_sinkhorn)):
            found = authors_pair.measure(pair, *convert(emb_x, emb_y))
            print(authors_pair.line(f"{name} k={k}", found, truth[k][name]))


if __name__ == "__main__":
    main()
