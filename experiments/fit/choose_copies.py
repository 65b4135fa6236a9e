"""How few vertices large shapes are bent with first, and how often they are bent whole.

Each pair is matched with all rounds of the bending on the whole shapes, and with copies
of some numbers of vertices and some rounds on the whole after them
(`Settings.coarse_vertices`, `Settings.last_rounds`); one attempt each. Edges are split
first (`upsample.py`) where --vertices asks for more than a shape has. Of each set it
says mean error, log odds of the evidence and the seconds of the bending. The embedded
shapes were used to choose, FAUST was looked at before, SMAL's animals only report.

With --jumps it says of each shape, in place of that, along how many edges of its copy
eigenfunctions jump, for some weights of the normals (`READ_NORMAL` of
`jfsf/matching/_coarse.py`): where both ends are read from vertices of the whole that
are `FAR` farther apart, along its edges, than twice the length of the edge.

    python -m experiments.fit.choose_copies [SET ...] [--vertices 30000] [--number 6] \
        [--jumps] [--data ROOT] [--out RESULT.json]
"""

import jax
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.bench.upsample import upsample
from jfsf.geometry import GeodesicSolver
from jfsf.matching._coarse import _with_normals
from jfsf.matching._match import attempted_pair
from jfsf.matching._settings import COARSE_VERTICES
from jfsf.mesh import decimate, surface_area
from jfsf.types import Mesh

SETS = "embedded", "faust_r", "smal_whole"
COPIES = (1200, 2500)
ROUNDS = (1, 2)
POINTS = 150  # of ground truth, at most, chosen at random
STAGE = "bending and conversion"
WEIGHTS = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1)  # of the normals, in sqrt(area)
FAR = 0.15  # in sqrt(area)


def main() -> None:
    parser = command_line.parser(__doc__, out="choose_copies.json", data=True)
    parser.add_argument("sets", nargs="*", default=SETS)
    parser.add_argument("--vertices", type=int, default=30_000)
    parser.add_argument("--number", type=int, default=6, help="pairs of a set")
    parser.add_argument("--jumps", action="store_true", help="of the copies only")
    args = command_line.parse(parser)
    root = args.data
    rows = []
    if args.jumps:
        _jumps_of_sets(args)
        return
    for data_set in protocol.named(args.sets):
        own = protocol.below(data_set, root)
        for pair in datasets.spread(datasets.pairs_of(own), args.number):
            x, y = datasets.load_pair_of(own, pair)
            found = _row(*(_larger(shape, args.vertices) for shape in (x, y)))
            rows.append({"set": own.name, "x": pair.x, "y": pair.y, "tried": found})
            print(rows[-1], flush=True)
            how = {"vertices": args.vertices, "number": args.number}
            summary = summaries(rows)
            results_file.write(args.out, settings=how, summary=summary, rows=rows)
    for line in summaries(rows):
        print(line)


def variants() -> dict[str, jfsf.Settings]:
    """Settings of one attempt, by copies and rounds."""
    whole = jfsf.Settings(retry_below=0, copies_above=2**62)
    found = {"whole": whole}
    for num in COPIES:
        for rounds in ROUNDS:
            found[f"{num} vertices, {rounds} rounds"] = jfsf.Settings(
                retry_below=0, copies_above=0, coarse_vertices=num, last_rounds=rounds
            )
    return found


def summaries(rows: list[dict]) -> list[dict]:
    """Of each set and variant, beside all rounds on the whole shapes."""
    found = []
    for name in dict.fromkeys(row["set"] for row in rows):
        own = [row["tried"] for row in rows if row["set"] == name]
        whole = np.array([one["whole"]["error"] for one in own])
        for variant in own[0]:
            errors = np.array([one[variant]["error"] for one in own])
            seconds = [one[variant]["seconds"] for one in own]
            line = {"set": name, "pairs": len(own), "variant": variant}
            line |= {"mean": float(errors.mean()), "median": float(np.median(errors))}
            line["wrong"] = sum(not protocol.is_right(error) for error in errors)
            line["better"] = int((errors < 0.99 * whole).sum())
            line["worse"] = int((errors > 1.01 * whole).sum())
            odds = [one[variant]["log_odds"] for one in own]
            line["log_odds"] = float(np.median(odds))
            found.append({**line, "seconds": float(np.median(seconds))})
    return found


def _jumps_of_sets(args) -> None:
    """Of the shapes of the pairs, each once."""
    out = args.out.with_stem("choose_copies_jumps")
    rows: list[dict] = []
    for data_set in protocol.named(args.sets):
        own = protocol.below(data_set, args.data)
        shapes = {}
        for pair in datasets.spread(datasets.pairs_of(own), args.number):
            both = datasets.load_pair_of(own, pair)
            shapes |= zip((pair.x, pair.y), both, strict=True)
        for name, shape in shapes.items():
            rows.append({"set": own.name, "shape": name, **jumps(shape.mesh)})
            print(rows[-1], flush=True)
            results_file.write(out, weights=WEIGHTS, far=FAR, rows=rows)


def jumps(mesh: Mesh) -> dict:
    """Edges of the coarse copy, and along how many a reading jumps, by weight."""
    mesh = mesh._replace(vertices=mesh.vertices / np.sqrt(surface_area(mesh)))
    copy = decimate(mesh, COARSE_VERTICES)
    edges, lengths = _edges(copy)
    own, sizes = _edges(mesh)
    graph = coo_matrix((sizes, tuple(own.T)), (len(mesh.vertices),) * 2).tocsr()
    counts = []
    for weight in WEIGHTS:
        tree = KDTree(_with_normals(*mesh, weight))
        ends = np.asarray(tree.query(_with_normals(*copy, weight))[1])[edges]
        some, row = np.unique(ends[:, 0], return_inverse=True)
        limit = FAR + 2 * lengths
        away = dijkstra(graph, False, some, limit=limit.max())[row, ends[:, 1]]
        counts.append(int(np.sum(away > limit)))
    return {"edges": len(edges), "jumps": counts}


def _edges(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Each edge once, (e, 2), and its length."""
    faces = np.asarray(mesh.faces)
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    edges = np.unique(ends, axis=0)
    across = np.diff(np.asarray(mesh.vertices)[edges], axis=1)[:, 0]
    return edges, np.linalg.norm(across, axis=1)


def _larger(shape: datasets.Shape, vertices: int) -> datasets.Shape:
    """With so many vertices, if it has fewer; the first are those of before."""
    n = max(vertices, len(shape.mesh.vertices))
    return shape._replace(mesh=upsample(shape.mesh, n))


def _row(x: datasets.Shape, y: datasets.Shape) -> dict[str, dict]:
    """Error, log odds and seconds of the bending, of each variant."""
    every = np.random.default_rng(0).permutation(len(x.truth))
    at = np.sort(every[:POINTS])
    distances = GeodesicSolver(y.mesh).rows(y.truth[at]) / np.sqrt(surface_area(y.mesh))
    found = {}
    for name, settings in variants().items():
        state = attempted_pair(x.mesh, y.mesh, settings=settings)
        match = jax.block_until_ready(state.result(settings))
        images = np.asarray(match.T_xy)[x.truth[at]]
        found[name] = {
            "error": float(distances[np.arange(len(at)), images].mean()),
            "log_odds": float(match.certificate.log_odds),
            "seconds": state.seconds[STAGE],
        }
    return found


if __name__ == "__main__":
    main()
