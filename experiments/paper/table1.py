"""Table 1 of Pai et al. (CVPR 2021): from a functional map to a map of points.

Every method converts the same aligned embeddings, those of the ground truth's
functional map in the adjoint space (eq. 5). Beyond the paper: the filter with the
authors' settings beside the library's, and the precise map.

    python -m experiments.paper.table1 --embedded --out experiments/results/table1.json
    python -m experiments.paper.table1 --data FAUST --within 10 --spread 30 \\
        --out t1.json
"""

from typing import NamedTuple

from jaxtyping import Array, Float, Int

from experiments.accuracy import datasets
from experiments.paper import compare
from experiments.paper.baselines import auction, cpd
from jfsf.convert import authors_sinkhorn, nearest, precise, sinkhorn, to_vertex
from jfsf.types import Maps


class Aligned(NamedTuple):
    emb_x: Float[Array, "n_x k"]
    emb_y: Float[Array, "n_y k"]
    faces_x: Int[Array, "m_x 3"]
    faces_y: Int[Array, "m_y 3"]


def _precise(emb_x, emb_y, faces_x, faces_y) -> Maps:
    forth, back = precise(emb_x, emb_y, faces_y), precise(emb_y, emb_x, faces_x)
    return Maps(to_vertex(forth), to_vertex(back))


METHODS: dict[str, compare.Method] = {
    "Auction": lambda aligned: auction(*aligned[:2]),
    "NN": lambda aligned: nearest(*aligned[:2]),
    "CPD": lambda aligned: cpd(*aligned[:2]),
    "Sinkhorn (authors' settings)": lambda aligned: authors_sinkhorn(*aligned[:2]),
    "Sinkhorn": lambda aligned: sinkhorn(*aligned[:2]),
    "precise": lambda aligned: _precise(*aligned),
}


def main() -> None:
    parser = compare.arguments(__doc__, METHODS, "table1.json")
    parser.add_argument("--k", type=int, default=50, help="eigenfunctions")
    args = parser.parse_args()
    datasets.check_arguments(parser, args)

    def aligned(_, pair: compare.Pair) -> Aligned:
        emb_x, emb_y = compare.true_embeddings(pair)
        return Aligned(emb_x, emb_y, pair.spec_x.faces, pair.spec_y.faces)

    compare.run(args, METHODS, aligned, k=args.k, functional=False)


if __name__ == "__main__":
    main()
