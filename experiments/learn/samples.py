"""What the network is trained on: bodies, views and pieces of them, and the truth.

    python -m experiments.learn.samples WHEEL FOLDER [--shards 12] [--first 0]

Each shard is made from its own number, so shards can be made side by side, and a run
that is stopped goes on. The network reads nothing that turns, moves or grows with the
shape: its spectrum, heat kernels, curvatures and its rim.
"""

from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from experiments import command_line
from experiments.accuracy.made_parts import seen
from experiments.learn.bodies import (
    BODY,
    Model,
    glued,
    random_body,
    read_model,
    rest_body,
)
from experiments.learn.others import random_other
from jfsf.learned._inputs import EIGENPAIRS, NetworkInput, network_input
from jfsf.mesh import MeshError, decimate, largest_component, surface_area
from jfsf.mesh._edit import Submesh
from jfsf.runtime._sizes import pad
from jfsf.spectral import spectrum
from jfsf.storage._atomic import write_atomically
from jfsf.types import Mesh

SHARD = 250  # samples in a file
LEAST, MOST = 450, 1024  # vertices of a sample
# By hand: shares of what is cut.
KINDS = {"whole": 0.3, "view": 0.35, "cut": 0.12, "view and cut": 0.13, "holes": 0.1}
OTHERS = 0.25  # share of shapes that are no people
GLUED = 0.3  # share of people whose limbs grow together where they touch


def main() -> None:
    parser = command_line.parser(__doc__)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shards", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    args = command_line.parse(parser)
    args.folder.mkdir(parents=True, exist_ok=True)
    model = read_model(args.wheel)
    template = args.folder / "template.npz"
    if not template.exists():
        np.savez(template, vertices=rest_body(model), faces=model.faces)
    for shard in range(args.first, args.first + args.shards):
        path = args.folder / f"shard_{shard:03d}.npz"
        if not path.exists():
            write_shard(path, model, np.random.default_rng(shard))
            print(path, flush=True)


def write_shard(path: Path, model: Model, rng: np.random.Generator) -> None:
    """Samples one after the other in long arrays; `sizes` says where each ends."""
    found: list[tuple[NetworkInput, np.ndarray]] = []
    while len(found) < SHARD:
        part, truth = random_part(model, rng)
        try:
            found.append((input_of(part), truth))
        except MeshError:  # a cut through a limb may leave next to nothing
            continue
    samples, truths = zip(*found, strict=True)
    half = lambda name: np.concatenate(
        [getattr(s, name) for s in samples], dtype=np.float16, casting="unsafe"
    )
    arrays = {
        "sizes": np.array([len(t) for t in truths]),
        "evals": np.stack([s.evals for s in samples]).astype(np.float32),
        "mass": np.concatenate([s.mass for s in samples]).astype(np.float32),
        "truth": np.concatenate(truths).astype(np.int16),
        **{name: half(name) for name in ("evecs", "slopes", "inputs")},
    }
    write_atomically(path, lambda file: np.savez(file, **arrays))


def random_part(model: Model, rng) -> tuple[Mesh, np.ndarray]:
    """A shape or a part of one, and the vertex of the template for each vertex.

    Where it is no person that is `BODY`, one more than the last.
    """
    while True:
        body = random_body(model, rng) if rng.random() > OTHERS else None
        if body is None:
            whole = random_other(rng)
        else:
            whole = Mesh(body, model.faces)
            if rng.random() < GLUED:
                whole = glued(whole, rng)
        points = np.asarray(whole.vertices)
        ends = points[np.asarray(whole.faces)[:, :2]]
        edge = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
        rough = points + rng.uniform(0, 0.3) * edge * rng.normal(size=points.shape)
        kind = rng.choice(list(KINDS), p=list(KINDS.values()))
        mesh = largest_component(Mesh(rough, whole.faces)).mesh
        for step in CUTS[kind]:
            mesh = step(mesh, rng).mesh
        # Afterwards: the rim of large triangles would be longer than that of a scan.
        mesh = largest_component(decimate(mesh, int(rng.integers(LEAST, MOST)))).mesh
        n = len(mesh.vertices)
        if LEAST // 2 <= n <= MOST:
            truth = np.full(n, BODY)
            if body is not None:
                truth = np.asarray(KDTree(body).query(mesh.vertices)[1])
            turn = Rotation.from_quat(rng.normal(size=4)).as_matrix()
            return Mesh(mesh.vertices @ turn.T, mesh.faces), truth


def _view(mesh: Mesh, rng) -> Submesh:
    return seen(mesh, rng.normal(size=3), rng)


def _cut(mesh: Mesh, rng) -> Submesh:
    """What lies on one side of a plane."""
    height = np.asarray(mesh.vertices) @ rng.normal(size=3)
    kept = np.asarray(height < np.quantile(height, rng.uniform(0.35, 0.9)))
    return _of_faces(mesh, np.all(kept[np.asarray(mesh.faces)], axis=1))


def _holes(mesh: Mesh, rng) -> Submesh:
    """Without a few balls."""
    points = np.asarray(mesh.vertices)
    kept = np.ones(len(points), bool)
    for centre in points[rng.choice(len(points), int(rng.integers(1, 5)))]:
        radius = rng.uniform(0.05, 0.2) * np.sqrt(surface_area(mesh))
        kept &= np.linalg.norm(points - centre, axis=1) > radius
    return _of_faces(mesh, np.all(kept[np.asarray(mesh.faces)], axis=1))


def _of_faces(mesh: Mesh, kept: np.ndarray) -> Submesh:
    if not kept.any():
        return Submesh(mesh, np.arange(len(mesh.vertices)))
    return largest_component(Mesh(mesh.vertices, np.asarray(mesh.faces)[kept]))


CUTS = {
    "whole": (),
    "view": (_view,),
    "cut": (_cut,),
    "view and cut": (_view, _cut),
    "holes": (_holes,),
}


def input_of(mesh: Mesh) -> NetworkInput:
    """What the network reads of a mesh of one piece, as numpy arrays."""
    spec = spectrum(mesh, EIGENPAIRS, cache=False)
    real = len(spec.mass)
    n = -(-real // MOST) * MOST  # few sizes: few compilations
    evals, *rest = map(np.asarray, network_input(pad(spec, n, 2 * n)))
    return NetworkInput(evals, *(values[:real] for values in rest))


if __name__ == "__main__":
    main()
