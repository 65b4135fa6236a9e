"""What each option of the filter contributes: an ablation that is not in the paper.

One option at a time differs from the library's default: neighbours k0, sharpness lam
with its scale rule, updates and their relaxation, the power p of the distance, uniform
or mass marginals, the weight of unilateral neighbours. Each converts the ground truth's
functional map (adjoint space) of k eigenfunctions.

    python -m experiments.paper.ablation --embedded --spread 8 \
        --out experiments/results/ablation.json
"""

from typing import Any, NamedTuple

from jaxtyping import Array, Float

from experiments.accuracy import datasets
from experiments.paper import compare
from jfsf.convert import authors_sinkhorn, maps_of, nearest, sinkhorn
from jfsf.types import Maps

VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "authors": authors_sinkhorn.keywords,
    **{f"k0 {k0}": {"k0": k0} for k0 in (5, 10, 40)},
    **{f"lam {lam:g}": {"lam": lam} for lam in (10.0, 40.0, 80.0, 160.0, 320.0)},
    **{
        f"lam {lam:g}, scale max": {"lam": lam, "scale": "max"}
        for lam in (100.0, 200.0, 500.0)
    },
    **{f"{n} plain updates": {"num_iters": n, "relax": 1.0} for n in (5, 10, 20, 50)},
    **{f"{n} updates": {"num_iters": n} for n in (12, 48, 96)},
    **{f"relax {r:g}": {"relax": r} for r in (1.3, 1.5, 1.8)},
    **{
        f"p {p:g}, lam {lam:g}": {"power": p, "lam": lam}
        for p, lam in ((0.5, 240.0), (2.0, 30.0), (2.0, 60.0))
    },
    "mass marginals": {"mass": True},
    "one-sided 0.5": {"unilateral_weight": 0.5},
    "one-sided 0": {"unilateral_weight": 0.0},
}


class Aligned(NamedTuple):
    emb_x: Float[Array, "n_x k"]
    emb_y: Float[Array, "n_y k"]
    mass_x: Float[Array, " n_x"]
    mass_y: Float[Array, " n_y"]


def _variant(options: dict[str, Any]) -> compare.Method:
    options = dict(options)
    mass = options.pop("mass", False)

    def convert(aligned: Aligned) -> Maps:
        marginals = aligned[2:] if mass else (None, None)
        return maps_of(sinkhorn(*aligned[:2], *marginals[:2], **options))

    return convert


METHODS: dict[str, compare.Method] = {
    "NN": lambda aligned: nearest(*aligned[:2]),
    **{name: _variant(options) for name, options in VARIANTS.items()},
}


def main() -> None:
    parser = compare.arguments(__doc__, METHODS, "ablation.json")
    parser.add_argument("--k", type=int, default=50, help="eigenfunctions")
    args = parser.parse_args()
    datasets.check_arguments(parser, args)

    def aligned(_, pair: compare.Pair) -> Aligned:
        emb_x, emb_y = compare.true_embeddings(pair)
        return Aligned(emb_x, emb_y, pair.spec_x.mass, pair.spec_y.mass)

    compare.run(args, METHODS, aligned, k=args.k, functional=False)


if __name__ == "__main__":
    main()
