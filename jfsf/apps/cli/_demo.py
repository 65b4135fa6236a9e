"""One embedded pair, converted and refined with nearest neighbour and with Sinkhorn.

Four of the five ways start from the same functional map, the best one of the search,
cut to the first size of ZoomOut. So between nearest neighbour and Sinkhorn only the
converter differs. The fifth is `jfsf.match`. All figures are measured in the run.
"""

import json
import platform
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from jfsf.types import Match, Mesh

HEADINGS = (
    "\nerror\nx1000",
    "bijec-\ntivity\nx1000",
    "\ncoverage\n%",
    "\nsmooth-\nness",
    "\n\nseconds",
    "\nfirst\ncall",
)


class Demo(NamedTuple):
    """The results of `jfsf demo`.

    record: for the JSON file: settings, versions, a row for each way; plain values.
    mesh_x, mesh_y: the pair.
    found: the last row, `match`.
    truth: vertices of X and of Y that correspond.
    """

    record: dict[str, Any]
    mesh_x: Mesh
    mesh_y: Mesh
    found: Match
    truth: tuple[np.ndarray, np.ndarray]


def measure(
    name_x: str,
    name_y: str,
    progress: Callable[[str], object],
    *,
    ks: tuple[int, ...] = tuple(range(40, 101, 10)),
    every: int = 10,
) -> Demo:
    """Match two embedded shapes in five ways and measure each map.

    Args:
        name_x, name_y: of `jfsf.data.names()`.
        progress: called with the name of each step as it begins.
        ks: sizes of the basis for ZoomOut; those above the number of eigenpairs are
            left out.
        every: the error is measured at every Nth point of the ground truth, and the
            bijectivity at every Nth vertex of X.

    Raises:
        ValueError: there is no such shape.
    """
    import jax
    import jax.numpy as jnp

    from jfsf import __version__
    from jfsf.convert import nearest, sinkhorn
    from jfsf.data import load
    from jfsf.evaluate import evaluate
    from jfsf.initial import search
    from jfsf.matching import Settings, match
    from jfsf.refine import zoomout
    from jfsf.spectral import embeddings, spectrum, wks
    from jfsf.spectral._laplacian import operators

    start = perf_counter()
    (mesh_x, points_x), (mesh_y, points_y) = load(name_x), load(name_y)
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    k = min(Settings().k, n_x // 4, n_y // 4)
    ks = tuple(size for size in ks if size <= k)

    def timed(step: str, work: Callable[[], Any]):
        progress(step)
        since = perf_counter()
        result = jax.block_until_ready(work())
        return result, round(perf_counter() - since, 3)

    def spectra():
        pair = (spectrum(mesh, k, cache=False) for mesh in (mesh_x, mesh_y))
        return tuple(jax.tree.map(jnp.asarray, spec) for spec in pair)

    def start_map():
        step = Settings().features.wks_step
        descs = (wks(spec)[:, ::step] for spec in (spec_x, spec_y))
        return search(spec_x, spec_y, *descs).C_yx[0, : ks[0], : ks[0]]

    def convert(converter, C_yx):
        pair = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
        # Columns of zeros change no distance, and equal widths share one program.
        missing = ks[-1] - len(C_yx)
        return converter(*(jnp.pad(emb, ((0, 0), (0, missing))) for emb in pair))

    def refine(converter):
        C_yx = zoomout(spec_x, spec_y, start_C, ks=ks, converter=converter)
        return convert(converter, C_yx)

    (spec_x, spec_y), spectra_took = timed("spectra", spectra)
    start_C, search_took = timed("search for the initial functional map", start_map)
    methods = {
        "plain (NN)": lambda: convert(nearest, start_C),
        "plain (Sinkhorn)": lambda: convert(sinkhorn, start_C),
        "ZoomOut (NN)": lambda: refine(nearest),
        "ZoomOut (Sinkhorn)": lambda: refine(sinkhorn),
        "jfsf.match": lambda: match(mesh_x, mesh_y, cache=False),
    }
    stiffness_x, _ = operators(mesh_x)
    measured = {
        "truth": (points_x, points_y),
        "every": every,
        "only": ("error", "bijectivity_x", "coverage_xy", "smoothness"),
        "operators_x": (stiffness_x, spec_x.mass),
        "operators_y": (None, np.asarray(spec_y.mass)),
    }
    rows, result = {}, None
    for name, method in methods.items():
        _, first_call = timed(name, method)
        result, seconds = timed(name, method)
        progress(f"{name}: geodesics")
        figures = evaluate(result, mesh_x, mesh_y, **measured)
        rows[name] = {
            "error": figures.error_mean,
            "bijectivity": figures.bijectivity_x,
            "coverage": figures.coverage_xy,
            "smoothness": figures.smoothness,
            "seconds": seconds,
            "first_call": first_call,
        }

    device = jax.devices()[0]
    record = {
        "pair": [name_x, name_y],
        "vertices": [n_x, n_y],
        "settings": {
            "start": f"best candidate of the search, first {len(start_C)} rows",
            "zoomout": list(ks),
            "eigenpairs": k,
            "space": "direct",
            "precision": str(start_C.dtype),
            "geodesics": "heat method",
            "measured_at": f"every {every}th template point and vertex of X, from 0",
            "seed": None,  # nothing here is random
        },
        "units": {
            "error": "mean geodesic distance on Y / sqrt(area of Y)",
            "bijectivity": "mean geodesic distance on X, x to T_yx[T_xy[x]]; as error",
            "coverage": "share of Y's area that T_xy hits",
            "smoothness": "mean Dirichlet energy of Y's coordinates, pulled back",
            "seconds": "second call; ZoomOut without the search, match from the meshes",
            "first_call": "seconds; compiles, or loads what an earlier run compiled",
        },
        "first_calls": {"spectra": spectra_took, "search": search_took},
        "rows": rows,
        "wall_seconds": round(perf_counter() - start, 1),
        "device": f"{device.platform} {device.device_kind}",
        "machine": platform.platform(),
        "versions": {
            "python": platform.python_version(),
            "jfsf": __version__,
            **{p: version(p) for p in ("jax", "jaxlib", "numpy", "scipy")},
        },
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    return Demo(record, mesh_x, mesh_y, result, (points_x, points_y))  # type: ignore


def table(record: dict[str, Any]) -> Table:
    """The rows of the record, to print."""
    (n_x, n_y), pair = record["vertices"], " -> ".join(record["pair"])
    took, settings = record["first_calls"], record["settings"]
    ks = settings["zoomout"]
    shown = Table(
        title=f"{pair} ({n_x} and {n_y} vertices)",
        caption=(
            f"All but jfsf.match start from the search's best map (first calls: "
            f"spectra {took['spectra']:.1f} s, search {took['search']:.1f} s); plain "
            f"converts it at {ks[0]} eigenfunctions, ZoomOut goes to {ks[-1]}. "
            f"seconds: second call; the first also compiles. Errors at "
            f"{settings['measured_at']}."
        ),
        caption_justify="left",
    )
    shown.add_column("", no_wrap=True)
    for heading in HEADINGS:
        shown.add_column(heading, justify="right")
    for name, row in record["rows"].items():
        shown.add_row(
            name,
            f"{1000 * row['error']:.2f}",
            f"{1000 * row['bijectivity']:.2f}",
            f"{100 * row['coverage']:.1f}",
            f"{row['smoothness']:.2f}",
            f"{row['seconds']:.2f}",
            f"{row['first_call']:.1f}",
        )
    return shown


def write(demo: Demo, folder: Path) -> list[Path]:
    """Write PAIR.json and, if matplotlib is there, PAIR.png; returns their paths."""
    from jfsf.storage._atomic import write_text

    stem = "_".join(demo.record["pair"])
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / f"{stem}.json"]
    write_text(written[0], json.dumps(demo.record, indent=2) + "\n")
    picture = folder / f"{stem}.png"
    try:
        from jfsf.apps.plot import draw_pair

        pair = demo.mesh_x, demo.mesh_y, demo.found.T_xy
        draw_pair(*pair, names=tuple(demo.record["pair"]), path=picture)
    except ImportError:
        return written
    return [*written, picture]


def write_page(demo: Demo, folder: Path) -> Path:
    """Write PAIR.html, the report of the last row; returns its path.

    Raises:
        ImportError: matplotlib is missing.
    """
    from jfsf.apps.report import Side, write_report

    name_x, name_y = demo.record["pair"]
    path = folder / f"{name_x}_{name_y}.html"
    rows = demo.record["rows"]
    write_report(
        path,
        Side(demo.mesh_x, name_x),
        Side(demo.mesh_y, name_y),
        demo.found,
        truth=demo.truth,
        seconds={"matching": rows["jfsf.match"]["seconds"]},
        cache=False,
    )
    return path
