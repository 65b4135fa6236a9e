"""Shape models of a collection: of its registered meshes, and of maps to vertices.

FOLDER is what `collection.py SET FOLDER` has made. The same shapes get the template's
mesh in three ways, from the same functional maps of the collection:

- `registered`: the template deformed onto each shape, as `jfsf collection` does;
- `filter`: each vertex of the template at its image, a vertex of the shape, by the
  Sinkhorn filter;
- `nearest`: the same by nearest neighbours of the spectral embeddings, as functional
  maps are converted elsewhere.

Of each a model of positions is fitted, and measured as in shape_model.py: generality
and specificity by the number of modes, as shares of sqrt(area); small is good.

    python -m experiments.accuracy.model_of_maps SET FOLDER --data ROOT
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jfsf
from experiments import command_line, results_file
from experiments.accuracy import protocol
from experiments.accuracy.collection import shapes_of
from jfsf.apps import model
from jfsf.apps.cli._collection_jobs import kept
from jfsf.apps.mapfiles import read_match
from jfsf.apps.model._quality import Distances
from jfsf.convert import nearest
from jfsf.spectral import embeddings, truncate
from jfsf.types import Mesh

COUNTS = (1, 2, 3, 5, 8, 12, 16)  # numbers of modes
WAYS = "registered", "filter", "nearest"


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("set", choices=protocol.SETS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--samples", type=int, default=100, help="of specificity")
    args = command_line.parse(parser)
    shapes = shapes_of(args.set, args.data)
    faces, names, positions = in_one_mesh(
        {name: shape.mesh for name, shape in shapes.items()}, args.folder / "model"
    )
    counts = tuple(count for count in COUNTS if count <= len(names) - 2)
    measured = {}
    for way, all_ in positions.items():
        measured[way] = measure(all_, faces, counts, args.samples)
        print(way, measured[way], flush=True)
    results_file.write(
        args.out or command_line.RESULTS / f"model_of_maps_{args.set}.json",
        settings={"set": args.set, "samples": args.samples},
        shapes=names,
        vertices=positions["registered"].shape[1],
        models=measured,
    )


def in_one_mesh(
    meshes: dict[str, Mesh], folder: Path
) -> tuple[np.ndarray, list[str], dict[str, np.ndarray]]:
    """Faces of the template, names of the shapes, and their (s, n, 3) in each way."""
    maps = {path.stem: path for path in sorted((folder / "maps").glob("*.npz"))}
    registered = {path.stem: path for path in (folder / "registered").glob("*.npz")}
    (template,) = set(registered) - set(maps)
    mesh = kept(folder / "shapes" / f"{template}.npz").mesh
    whole = jfsf.basis(mesh)
    found = {way: [] for way in WAYS}
    for name, path in maps.items():
        match, vertices = read_match(path), meshes[name].vertices
        with np.load(registered[name]) as file:
            found["registered"].append(file["vertices"])
        found["filter"].append(vertices[np.asarray(match.T_xy)])
        spec = jfsf.basis(meshes[name])
        k = min(len(whole.evals), len(spec.evals), *match.C_yx.shape)
        both = (truncate(one, k).evecs for one in (whole, spec))
        T_xy = nearest(*embeddings(match.C_yx[:k, :k], *both)).T_xy
        found["nearest"].append(vertices[np.asarray(T_xy)])
    return mesh.faces, list(maps), {way: np.stack(all_) for way, all_ in found.items()}


def measure(positions: np.ndarray, faces: np.ndarray, counts, samples: int) -> dict:
    """Generality and specificity of a model of positions."""
    points = jnp.asarray(positions)
    fitted = model.fit_model(points, faces)
    special = model.specificity(
        fitted, points, jax.random.key(0), samples=samples, counts=counts
    )
    return {
        "compactness": np.asarray(model.compactness(fitted).share)[:16].tolist(),
        "generality": table(model.generality(points, faces, counts=counts)),
        "specificity": table(special),
    }


def table(distances: Distances) -> list[dict]:
    """A row for each number of modes."""
    return [
        {"modes": int(modes), "share": float(share)}
        for modes, share in zip(distances.counts, distances.share, strict=True)
    ]


if __name__ == "__main__":
    main()
