"""Large meshes with known maps: split edges of a shape at their middle.

    python -m experiments.bench.upsample man_walk man_up --vertices 100000 --out FOLDER

writes NAME.off of embedded shapes and corres/NAME.vts, the vertex of each template
point (see datasets.py), which subdivision does not move: old vertices keep their
numbers.
"""

from pathlib import Path

import numpy as np

from experiments import command_line
from jfsf import data
from jfsf.storage._atomic import write_atomically
from jfsf.types import Mesh


def upsample(mesh: Mesh, n: int) -> Mesh:
    """The same surface with n vertices, those of `mesh` first.

    Whole rounds split every edge (each triangle becomes four); the last one splits the
    longest edges only. Triangles that share an edge split it alike, so a closed mesh
    stays closed.

    Raises:
        ValueError: the mesh has more than n vertices already.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)
    if len(vertices) > n:
        raise ValueError(f"upsample: n is {n}, the mesh has {len(vertices)} vertices")
    while len(vertices) < n:
        ends = np.stack([faces, np.roll(faces, -1, 1)], 2)  # edge c leaves corner c
        edges, index = np.unique(
            np.sort(ends.reshape(-1, 2), 1), axis=0, return_inverse=True
        )
        one, two = vertices[edges.T]
        order = np.argsort(-np.linalg.norm(one - two, axis=1), kind="stable")
        cut = order[: n - len(vertices)]
        middle = np.full(len(edges), -1)
        middle[cut] = len(vertices) + np.arange(len(cut))
        faces = _split(faces, middle[index].reshape(-1, 3))
        vertices = np.concatenate([vertices, (one[cut] + two[cut]) / 2])
    return Mesh(vertices, faces.astype(np.int32))


def _split(faces, middle):
    """Triangles cut at `middle` of edges 01, 12, 20; -1 where an edge stays whole."""
    count = (middle >= 0).sum(1)
    # Turn each so that cut edges come first: 01, or 01 and 12.
    first = np.where(count == 1, (middle >= 0).argmax(1), 0)
    first = np.where(count == 2, ((middle < 0).argmax(1) + 1) % 3, first)
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, 1).T
    ab, bc, ca = np.take_along_axis(middle, turn, 1).T
    parts = {
        0: [(a, b, c)],
        1: [(a, ab, c), (ab, b, c)],
        2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
        3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    }
    return np.concatenate(
        [
            np.stack(part, 1)[count == cuts]
            for cuts, triangles in parts.items()
            for part in triangles
        ]
    )


def write_off(path: Path, mesh: Mesh) -> None:
    """Write an OFF file, completely or not at all."""

    def write(file):
        file.write(f"OFF\n{len(mesh.vertices)} {len(mesh.faces)} 0\n".encode())
        np.savetxt(file, mesh.vertices, "%.9g")
        np.savetxt(file, np.pad(mesh.faces, ((0, 0), (1, 0)), constant_values=3), "%d")

    write_atomically(path, write)


def main() -> None:
    parser = command_line.parser(__doc__, out=Path("large"))
    parser.add_argument("names", nargs="+", help="embedded shapes")
    parser.add_argument("--vertices", type=int, default=100_000)
    args = command_line.parse(parser)
    corres = args.out / "corres"
    corres.mkdir(parents=True, exist_ok=True)
    for name in args.names:
        sample = data.load(name)
        path = args.out / f"{name}.off"
        write_off(path, upsample(sample.mesh, args.vertices))
        np.savetxt(corres / f"{name}.vts", sample.template_to_vertex + 1, "%d")
        print(f"{path}: {args.vertices} vertices")


if __name__ == "__main__":
    main()
