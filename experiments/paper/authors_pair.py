"""Parity with the authors' own code on their own pair, and the library's defaults.

Every row of reference/authors_pair.json, next to --data, is computed again by jfsf:
conversion at ten sizes with the reference settings, in float64 and float32, and with
the library's defaults in float32; and both ZoomOuts. Errors are Euclidean / sqrt(area),
as in that file.

    python -m experiments.paper.authors_pair --data FOLDER [--grid] [--out RESULT.json]
"""

import json
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jfsf
from experiments import command_line, results_file
from jfsf.apps import mapfiles
from jfsf.convert import authors_sinkhorn, nearest, sinkhorn
from jfsf.evaluate import coverage, smoothness
from jfsf.mesh import surface_area
from jfsf.refine import zoomout
from jfsf.spectral import embeddings, functional_map, spectrum, truncate
from jfsf.spectral._laplacian import operators
from jfsf.types import Mesh, Spectrum

K = 100
KS = tuple(range(20, K + 1, 16))
COLUMNS = {"error": 5, "bijectivity": 5, "coverage": 4, "smoothness": 3}  # digits there
GRID = {
    "k0": (10, 20, 50),
    "num_iters": (10, 20, 40),
    "relax": (1.0, 1.7),
    "lam": (40.0, 80.0, 160.0),
}

CONVERTERS = {"nn": nearest, "sinkhorn": authors_sinkhorn}


class Pair(NamedTuple):
    """Man0 and Man1, vertex i on vertex i, and the authors' rough map to start from."""

    mesh_x: Mesh
    mesh_y: Mesh
    spec_x: Spectrum
    spec_y: Spectrum
    stiffness_x: Any
    start: np.ndarray


def load(data: Path) -> Pair:
    folder = data / "authors_pair"
    x, y = (jfsf.read(folder / f"{name}.off") for name in ("Man0", "Man1"))
    spec_x, spec_y = (spectrum(mesh, K, laplacian="cotan") for mesh in (x, y))
    stiffness_x = operators(x, laplacian="cotan")[0]
    start = mapfiles.read_map(
        folder / "Man0_Man1.map",
        n_from=len(x.vertices),
        n_to=len(y.vertices),
    )
    return Pair(x, y, spec_x, spec_y, stiffness_x, start)


def reference(data: Path) -> dict:
    """k -> the row of the conversion; "zoomout" -> converter -> the row."""
    path = data.parent / "reference" / "authors_pair.json"
    content = json.loads(path.read_text())
    rows = {row["k"]: row for row in content["conversion"]["rows"]}
    zoomed = content["refinement"]["rows"]
    return {**rows, "zoomout": {name: zoomed[f"zoomout_{name}"] for name in CONVERTERS}}


def embedded(pair: Pair, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Aligned embeddings of the identity, float64: plain pseudo-inverse, no mass."""
    evecs_x = np.asarray(pair.spec_x.evecs)[:, :k]
    evecs_y = np.asarray(pair.spec_y.evecs)[:, :k]
    return evecs_x @ (np.linalg.pinv(evecs_x) @ evecs_y), evecs_y


def measure(pair: Pair, T_xy, T_yx) -> dict:
    """The four geometric metrics as the authors measure them."""
    T_xy, T_yx = np.asarray(T_xy), np.asarray(T_yx)
    x, y = pair.mesh_x.vertices, pair.mesh_y.vertices
    error = np.linalg.norm(y[T_xy] - y, axis=1).mean()
    there_and_back = np.linalg.norm(x[T_yx[T_xy]] - x, axis=1).mean()
    return {
        "error": float(error / np.sqrt(surface_area(pair.mesh_y))),
        "bijectivity": float(there_and_back / np.sqrt(surface_area(pair.mesh_x))),
        "coverage": float(coverage(T_xy, np.asarray(pair.spec_y.mass))),
        "smoothness": smoothness(T_xy, y, pair.stiffness_x),
    }


def line(name: str, found: dict, truth: dict | None = None) -> str:
    """One printed row; * marks a number equal to the reference to all digits."""
    cells = []
    for column, digits in COLUMNS.items():
        text = f"{found[column]:.{digits}f}"
        if truth is not None:
            same = round(found[column], digits) == truth[column]
            text += "*" if same else f" ({truth[column]:.{digits}f})"
        cells.append(f"{column} {text:19s}")
    return f"{name:32s} " + " ".join(cells).rstrip()


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument(
        "--ks", type=int, nargs="+", default=tuple(range(10, K + 1, 10))
    )
    parser.add_argument("--grid", action="store_true", help="also sweep the settings")
    args = command_line.parse(parser)
    pair, truth = load(args.data), reference(args.data)
    rows: list[dict] = []

    def add(name, found, expected=None, **settings):
        rows.append({"name": name, **settings, **found, "reference": expected})
        print(line(name, found, expected), flush=True)

    for bits in (64, 32):
        for k in args.ks:
            for name, converter in CONVERTERS.items():
                found = _convert(pair, k, converter, bits)
                label = f"{name} k={k} float{bits}"
                add(label, found, truth[k][name], k=k, bits=bits)
    for k in (50, 100):
        found = _convert(pair, k, sinkhorn, 32)
        add(f"sinkhorn defaults k={k} float32", found, k=k, bits=32)
    for bits in (64, 32):
        for name, converter in CONVERTERS.items():
            found = _zoom_as_they_do(pair, converter, bits)
            add(f"zoomout {name} float{bits}", found, truth["zoomout"][name], bits=bits)
    for name, converter in (("nn", nearest), ("sinkhorn defaults", sinkhorn)):
        add(f"jfsf.zoomout {name} float32", _zoom(pair, converter), bits=32)
    if args.grid:
        for k, *values in product((50, 100), *GRID.values()):
            settings = dict(zip(GRID, values, strict=True))
            found = _convert(pair, k, partial(sinkhorn, **settings), 32)
            label = " ".join(f"{key}={value:g}" for key, value in settings.items())
            add(f"k={k} {label}", found, k=k, bits=32, settings=settings)
    if args.out:
        settings = authors_sinkhorn.keywords
        results_file.write(args.out, reference_settings=settings, rows=rows)


def _convert(pair: Pair, k: int, converter, bits: int) -> dict:
    return measure(pair, *_maps(converter, *embedded(pair, k), bits))


def _maps(converter, emb_x, emb_y, bits: int):
    with jax.enable_x64(bits == 64):
        emb_x, emb_y = (jnp.asarray(x, f"float{bits}") for x in (emb_x, emb_y))
        found = converter(emb_x, emb_y)
        return np.asarray(found.T_xy), np.asarray(found.T_yx)


def _zoom_as_they_do(pair: Pair, converter, bits: int) -> dict:
    """Direct space, spectra in mesh units, plain pseudo-inverse; the map at k = 100."""
    evecs_x = pair.spec_x.evecs / np.sqrt(surface_area(pair.mesh_x))
    evecs_y = pair.spec_y.evecs / np.sqrt(surface_area(pair.mesh_y))
    T_xy, T_yx = pair.start, pair.start
    for k in KS:
        C_yx = np.linalg.pinv(evecs_x[:, :k]) @ evecs_y[T_xy, :k]
        embs = evecs_x[:, :k], evecs_y[:, :k] @ C_yx.T
        T_xy, T_yx = _maps(converter, *embs, bits)
    return measure(pair, T_xy, T_yx)


def _zoom(pair: Pair, converter) -> dict:
    """The library's own: spectra at area 1, areas in the pseudo-inverse."""
    spec_x, spec_y = (
        jax.tree.map(lambda x: jnp.asarray(x, x.dtype.str.replace("f8", "f4")), spec)
        for spec in (pair.spec_x, pair.spec_y)
    )
    start = functional_map(jnp.asarray(pair.start), truncate(spec_x, KS[0]), spec_y)
    C_yx = zoomout(spec_x, spec_y, start, ks=KS, converter=converter)
    embs = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    found = converter(*embs)
    return measure(pair, found.T_xy, found.T_yx)


if __name__ == "__main__":
    main()
