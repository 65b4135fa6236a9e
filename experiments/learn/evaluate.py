"""How well the network's answers alone match shapes that it never saw.

    python -m experiments.learn.evaluate FOLDER --data ROOT [--sets creatures ...] \\
        [--spread 10] [--out RESULT.json]

A vertex of X goes to the vertex of Y whose chances of the anchors agree best with its
own. Of each set: mean error in sqrt(area of Y), the median over points, the share of
points that are further than 0.25 off, pairs with a mean below 0.1, and the share of the
shapes that are taken for people: more than half of their area is.
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.match_pairs import some_points
from experiments.learn.network import Network, Shape
from experiments.learn.samples import shape_of
from experiments.learn.train import anchors_of
from jfsf.geometry import GeodesicSolver
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import vertex_areas
from jfsf.runtime._sizes import with_rows
from jfsf.types import Mesh

SETS = "creatures embedded gorilla topkids_low faust_r tosca_iso_r becos_pf becos_pp"
OTHERS = "smal_whole shrec07 shrec20_full calcanei mouse_skulls hdm_molars"
FAR_OFF = 0.25
STEP = 1024  # shapes are padded to multiples of it


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sets", nargs="+", default=[*SETS.split(), *OTHERS.split()])
    parser.add_argument("--spread", type=int, default=10)
    args = command_line.parse(parser)
    network, rows = read_network(args.folder), {}
    for data_set in protocol.named(args.sets):
        own = protocol.below(data_set, Path(args.data))
        found = []
        for pair in datasets.spread(datasets.pairs_of(own), args.spread):
            found.append(measured(network, *datasets.load_pair_of(own, pair)))
            print(pair.x, pair.y, {k: round(v, 3) for k, v in found[-1].items()})
        mean = lambda key, found=found: float(np.mean([row[key] for row in found]))
        rows[data_set.name] = {key: mean(key) for key in found[0]} | {
            "pairs": len(found),
            "below 0.1": sum(row["error"] < protocol.RIGHT for row in found),
        }
        print(data_set.name, rows[data_set.name], flush=True)
        if args.out:
            results_file.write(args.out, sets=rows)


def read_network(folder: Path) -> Network:
    """The trained one."""
    anchors, _ = anchors_of(folder)
    with np.load(next(folder.glob("shard_*.npz"))) as file:
        inputs = file["inputs"].shape[1]
    network = Network(inputs, len(anchors) + 1, jax.random.key(0))
    return eqx.tree_deserialise_leaves(folder / "network.eqx", network)


def chances(network: Network, mesh: Mesh) -> np.ndarray:
    """(n, a + 1) of each anchor at each vertex, and that it is of no person."""
    sample, n = shape_of(mesh), len(mesh.vertices)
    size = -(-n // STEP) * STEP
    rest = {k: with_rows(v, size) for k, v in sample._asdict().items() if k != "evals"}
    shape = Shape(evals=sample.evals, **rest)
    shape = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), shape)
    return np.asarray(_run(network, shape))[:n]


@eqx.filter_jit
def _run(network, shape):
    return jax.nn.softmax(network(shape))


def measured(network: Network, x: datasets.Shape, y: datasets.Shape) -> dict:
    """Errors of the map from X to Y at the points of the ground truth."""
    first, second = (chances(network, shape.mesh) for shape in (x, y))
    at = some_points(len(x.truth))
    own, others = np.sqrt(first[x.truth[at], :-1]), np.sqrt(second[:, :-1])
    images = (own @ others.T).argmax(1)
    far = GeodesicSolver(y.mesh).rows(y.truth[at]) / np.sqrt(surface_area(y.mesh))
    errors = far[np.arange(len(at)), images]
    return {
        "error": float(errors.mean()),
        "median": float(np.median(errors)),
        "far off": float((errors > FAR_OFF).mean()),
        "taken for people": float(
            np.mean([_is_person(first, x), _is_person(second, y)])
        ),
    }


def _is_person(found: np.ndarray, shape: datasets.Shape) -> bool:
    areas = vertex_areas(*shape.mesh)
    return bool(areas @ found[:, -1] < areas.sum() / 2)


if __name__ == "__main__":
    main()
