"""jfsf demo | match | evaluate | info: the command line.

Exit codes: 0 done, 1 bad input (one line on stderr says which), 2 wrong usage.
"""

import json
import os
import tempfile
import warnings
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from typer.core import TyperGroup

from jfsf.types import Certificate, Mesh

FEWEST = 160  # vertices; see `match`
THRESHOLDS = (0.01, 0.02, 0.05, 0.1)


class _OneLine(TyperGroup):
    """Turns what bad input raises into one line on stderr and exit code 1."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except (ValueError, ImportError, OSError) as error:
            typer.echo(f"jfsf: {' '.join(str(error).split())}", err=True)
            raise typer.Exit(1) from None


app = typer.Typer(
    name="jfsf",
    cls=_OneLine,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Orientation(StrEnum):
    preserve = "preserve"
    reverse = "reverse"
    any = "any"


class Up(StrEnum):
    x = "x"
    y = "y"
    z = "z"


FORMATS = "OFF, OBJ, PLY, STL, GLB or glTF file."
MeshX = Annotated[Path, typer.Argument(metavar="X", help=FORMATS)]
MeshY = Annotated[Path, typer.Argument(metavar="Y", help=FORMATS)]
UpAxis = Annotated[Up, typer.Option(help="Axis that points up, for the picture.")]


def main() -> None:
    """The entry point: `app`, with compiled programs kept between processes."""
    app(obj="keep compiled programs")


def _version(asked: bool) -> None:
    if asked:
        from jfsf import __version__

        typer.echo(f"jfsf {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print it and stop."
        ),
    ] = False,
) -> None:
    """Dense maps between non-rigid 3D shapes: Fast Sinkhorn Filters in JAX."""


@app.command()
def demo(
    ctx: typer.Context,
    pair: Annotated[
        tuple[str, str], typer.Option(help="Two embedded shapes, X and Y.")
    ] = ("man_walk", "man_up"),
    out: Annotated[Path, typer.Option(help="Folder for the JSON and the PNG.")] = Path(
        "jfsf-demo"
    ),
) -> None:
    """Match two embedded shapes; compare nearest neighbour and Sinkhorn.

    Example: jfsf demo --pair man_walk woman_up --out results
    """
    from jfsf import demo as demos

    _keep_compiled(ctx, True)
    out.mkdir(parents=True, exist_ok=True)
    with _status("starting ...") as status:
        result = demos.measure(*pair, lambda what: status.update(f"{what} ..."))
        status.update("drawing ...")
        written = demos.write(result, out)
    console = Console()
    console.print(demos.table(result.record))
    for path in written:
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


@app.command()
def match(
    ctx: typer.Context,
    x: MeshX,
    y: MeshY,
    out: Annotated[Path, typer.Option(help="The .npz to write.")],
    png: Annotated[
        Path | None, typer.Option(help="A picture of the map (needs matplotlib).")
    ] = None,
    orientation: Annotated[
        Orientation,
        typer.Option(help="Keep left and right, swap them, or take the better map."),
    ] = Orientation.preserve,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            help="Text file of known pairs: a line holds a vertex of X and one of Y, "
            "counted from 0."
        ),
    ] = None,
    largest_component: Annotated[
        bool,
        typer.Option(
            "--largest-component",
            help="Match the largest pieces only. Maps then count kept vertices; "
            "index_x and index_y in the file hold their numbers in X and Y.",
        ),
    ] = False,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Leave the cache folder alone.")
    ] = False,
    up: UpAxis = Up.y,
) -> None:
    """Map two meshes to each other, both ways.

    Writes T_xy (the vertex of Y for each vertex of X), T_yx (the other way; both int32,
    counted from 0), C_yx (the functional map) and certificate_* (evidence of quality).

    Example: jfsf match cat.off lion.off --out map.npz --png map.png
    """
    from jfsf.match import match as match_meshes
    from jfsf.viz import draw_pair

    _can_write(out, ".npz")
    if png is not None:
        _can_write(png, ".png")
        _need_matplotlib()
    mesh_x, index_x = _matchable(x, largest_component)
    mesh_y, index_y = _matchable(y, largest_component)
    pairs = None
    if landmarks is not None:
        pairs = _landmarks(landmarks, (index_x, index_y))
    _keep_compiled(ctx, not no_cache)
    with _status("matching (the first time, this compiles) ...") as status:
        found = match_meshes(
            mesh_x,
            mesh_y,
            orientation=orientation.value,
            landmarks=pairs,  # type: ignore
            cache=not no_cache,
        )
        status.update("writing ...")
        _write(out, found, index_x=index_x, index_y=index_y)
        if png is not None:
            T_xy = np.asarray(found.T_xy)
            draw_pair(mesh_x, mesh_y, T_xy, path=png, up=up.value)
    console = Console()
    console.print(_certificate_table(found.certificate))
    notes = _warnings(found.certificate, orientation.value)
    for path, mesh in ((x, mesh_x), (y, mesh_y)):
        if _one_sided(mesh):
            notes.append(f"{path}: cannot be wound consistently; check left and right")
    for line in notes:
        console.print(f"warning: {line}", soft_wrap=True, markup=False)
    for path in filter(None, (out, png)):
        console.print(f"wrote {path}", soft_wrap=True, markup=False)


@app.command()
def evaluate(
    x: MeshX,
    y: MeshY,
    map_file: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help="What match wrote, or a .npz, .mat, .map, .vts of T_xy."
        ),
    ],
    gt_x: Annotated[
        Path | None,
        typer.Option(help="Ground truth: line i is the vertex of X at point i."),
    ] = None,
    gt_y: Annotated[
        Path | None, typer.Option(help="The same for Y; text files count from 1.")
    ] = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="Exact geodesics, slow (needs pygeodesic).")
    ] = False,
    every: Annotated[
        int, typer.Option(min=1, help="Measure at every Nth point and vertex.")
    ] = 1,
    base: Annotated[
        int | None,
        typer.Option(
            min=0, max=1, help="First index in text files that break the convention."
        ),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures here too.")
    ] = None,
) -> None:
    """Measure a map, against ground truth where there is one.

    Distances are geodesic and relative to sqrt(area).

    Example: jfsf evaluate a.off b.off map.npz --gt-x a.vts --gt-y b.vts --every 5
    """
    mesh_x, mesh_y, maps, truth = _read_pair(x, y, map_file, gt_x, gt_y, base)
    if json_file is not None:
        _can_write(json_file, ".json")
    figures = _figures(mesh_x, mesh_y, maps, truth, exact, every)
    shown = Table(title=map_file.name)
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    for name, value in figures.items():
        shown.add_row(name.replace("_", " "), f"{value:.4g}")
    Console().print(shown)
    if json_file is not None:
        from jfsf import __version__

        record = {
            "x": str(x),
            "y": str(y),
            "map": str(map_file),
            "ground_truth": None if truth is None else [str(gt_x), str(gt_y)],
            "geodesics": "exact" if exact else "heat method",
            "every": every,
            "jfsf": __version__,
            "figures": figures,
        }
        json_file.write_text(json.dumps(record, indent=2) + "\n")


@app.command()
def info(
    path: Annotated[Path, typer.Argument(metavar="MESH", help=FORMATS)],
) -> None:
    """Say what is in a mesh file, and whether it can be matched.

    Exit code 0 if it can, 1 if not.

    Example: jfsf info cat.off
    """
    from jfsf.mesh import MeshError, check, read

    mesh = read(path)
    report = check(mesh)
    shown = Table(title=path.name, show_header=False)
    for name, value in report._asdict().items():
        if value is not None:
            words = {True: "yes", False: "no"}
            text = words[value] if isinstance(value, bool) else f"{value:.6g}"
            shown.add_row(name.replace("_", " "), text)
    console = Console()
    console.print(shown)
    try:
        _validate(mesh, path)
    except MeshError as error:
        console.print(f"cannot be matched: {error}", soft_wrap=True, markup=False)
        raise typer.Exit(1) from None
    notes = ""
    if report.faces == 0:
        notes = "; a point cloud tells no left from right"
    elif _one_sided(mesh):
        notes = "; it cannot be wound consistently, so left and right may be swapped"
    console.print(f"can be matched{notes}", soft_wrap=True)


def _keep_compiled(ctx: typer.Context, cache: bool) -> None:
    # Only `main` asks for it: a library, or a test, must not change jax's settings.
    if not cache or ctx.find_root().obj is None:
        return
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    import jax

    from jfsf.cache import folder

    jax.config.update("jax_compilation_cache_dir", str(folder() / "xla"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    # XLA logs an error about its own tuning flags for each program it loads.
    jax.config.update("jax_logging_level", "CRITICAL")
    # A cache that cannot be read or written is done without.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation")


def _status(text: str):
    return Console(stderr=True).status(text)


def _can_write(path: Path, suffix: str) -> None:
    # Before the work, not after it.
    if path.suffix.lower() != suffix:
        raise ValueError(f"{path}: is to be written as {suffix}, name it so")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder {path.parent}; make it first")


def _need_matplotlib() -> None:
    if find_spec("matplotlib") is None:
        raise ImportError("drawing needs matplotlib: pip install 'jfsf[viz]'")


def _validate(mesh: Mesh, path: Path) -> None:
    from jfsf.mesh import MeshError, validate

    try:
        validate(mesh, name=str(path))
    except MeshError as error:
        hint = str(error).replace("largest_component", "match --largest-component")
        raise MeshError(hint) from None
    if (n := len(mesh.vertices)) < FEWEST:
        raise MeshError(
            f"{path}: has {n} vertices, matching needs {FEWEST}; subdivide the mesh"
        )


def _one_sided(mesh: Mesh) -> bool:
    from jfsf.mesh import check, orient

    return len(mesh.faces) > 0 and not check(orient(mesh)).consistent


def _matchable(path: Path, largest: bool):
    """The mesh, and with `largest` the old numbers of its vertices."""
    from jfsf.mesh import largest_component, read

    mesh, index = read(path), None
    if largest:
        mesh, index = largest_component(mesh)
    _validate(mesh, path)
    return mesh, index


def _landmarks(path: Path, kept) -> np.ndarray:
    """Rows (vertex of X, vertex of Y); in kept vertices where pieces were dropped."""
    try:
        lines = [line.split("#")[0].split() for line in path.read_text().splitlines()]
        pairs = np.array([[int(word) for word in line] for line in lines if line])
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise ValueError
    except ValueError:
        raise ValueError(
            f"{path}: a line holds a vertex of X and one of Y, counted from 0"
        ) from None
    for column, index in enumerate(kept):
        if index is None:
            continue
        place = np.searchsorted(index, pairs[:, column]).clip(max=len(index) - 1)
        lost = index[place] != pairs[:, column]
        if lost.any():
            raise ValueError(
                f"{path}: vertex {pairs[lost, column][0]} of {'XY'[column]} is not in "
                "the largest piece; leave that line out"
            )
        pairs[:, column] = place
    return pairs


def _write(path: Path, found, **indices) -> None:
    from jfsf.cache import store
    from jfsf.mapfiles import write_match

    if all(index is None for index in indices.values()):
        write_match(path, found)
        return
    with tempfile.TemporaryDirectory() as folder:
        write_match(part := Path(folder) / "match.npz", found)
        with np.load(part) as file:
            store(path, **file, **indices)


def _certificate_table(certificate: Certificate) -> Table:
    turned = float(certificate.orientation)
    side = "keeps left and right" if turned > 0 else "swaps left and right"
    if np.isnan(turned):
        side = "unknown: a point cloud, or no winding"
    elif abs(turned) < 0.5:
        side = "unclear: parts may be flipped"
    readings = {
        "marginal_error": "transport plan's gap to its marginals; 0 is exact",
        "empty": "vertices that no mass reached",
        "coverage_xy": "share of Y's area that is hit",
        "coverage_yx": "share of X's area that is hit",
        "bijectivity_x": "mean way from X to Y and back; two random vertices are at 1",
        "bijectivity_y": "mean way from Y to X and back",
        "orthogonality": "|C^T C - I|; 0 if areas are kept",
        "orientation": side,
        "gap": "the runner-up's extra energy, relative; 0 is a tie",
        "nn_agreement": "share that nearest neighbour maps alike",
        "finite": "no number overflowed",
    }
    shown = Table(title="certificate: evidence without ground truth")
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    shown.add_column("reading")
    for name, value in certificate._asdict().items():
        value = np.asarray(value)
        form = "+.2f" if name == "orientation" else ".4g"
        text = ("no", "yes")[int(value)] if value.dtype == bool else f"{value:{form}}"
        shown.add_row(name, text, readings.get(name, ""))
    return shown


def _warnings(certificate: Certificate, orientation: str) -> list[str]:
    turned = float(certificate.orientation)
    right = {"preserve": turned, "reverse": -turned, "any": abs(turned)}[orientation]
    covered = min(float(certificate.coverage_xy), float(certificate.coverage_yx))
    away = max(float(certificate.bijectivity_x), float(certificate.bijectivity_y))
    found = {
        "a number is not finite: do not use this map": not bool(certificate.finite),
        f"orientation {turned:+.2f} is not what {orientation!r} asks for: left and "
        "right, or front and back, may be swapped; landmarks decide": right < 0.5,
        f"only {covered:.0%} of a shape is hit: the shapes may differ too much": (
            covered < 0.5
        ),
        f"there and back again ends {away:.2f} away: the maps disagree": away > 0.1,
        f"{int(certificate.empty)} vertices got no mass": bool(certificate.empty),
    }
    return [line for line, wrong in found.items() if wrong]


def _read_pair(x, y, map_file, gt_x, gt_y, base):
    """Both meshes, the arrays of the map file, and the ground truth or None.

    After --largest-component the map counts kept vertices: so do these meshes then, and
    the points of the ground truth that were dropped are left out.
    """
    from jfsf.mapfiles import MapFileError, read_ground_truth, read_map
    from jfsf.mesh import read

    if (gt_x is None) != (gt_y is None):
        raise ValueError("ground truth takes both --gt-x and --gt-y")
    mesh_x, mesh_y = read(x), read(y)
    truth = None
    if gt_x is not None:
        sizes = {"n_x": len(mesh_x.vertices), "n_y": len(mesh_y.vertices)}
        truth = read_ground_truth(gt_x, gt_y, **sizes, base=base)
    arrays = {}
    if map_file.suffix.lower() == ".npz":
        read_map(map_file)  # says what is wrong with the file
        with np.load(map_file) as file:
            arrays = {name: file[name] for name in file.files}
    for side, name in enumerate(("index_x", "index_y")):
        if (index := arrays.get(name)) is None:
            continue
        mesh = (mesh_x, mesh_y)[side]
        place = np.full(len(mesh.vertices), -1, np.int32)
        if not 0 <= index.min() <= index.max() < len(place):
            raise MapFileError(f"{map_file}: {name} is another mesh's")
        place[index] = np.arange(len(index))
        faces = place[mesh.faces]
        part = Mesh(mesh.vertices[index], faces[(faces >= 0).all(1)])
        mesh_x, mesh_y = (part, mesh_y) if side == 0 else (mesh_x, part)
        if truth is not None:
            points = place[truth[side]]
            known = points >= 0
            truth = type(truth)(
                *(points[known] if i == side else t[known] for i, t in enumerate(truth))
            )
    n_x, n_y = len(mesh_x.vertices), len(mesh_y.vertices)
    text = base if map_file.suffix.lower() in (".vts", ".map") else None
    maps = {"T_xy": read_map(map_file, n_from=n_x, n_to=n_y, base=text)}
    if "T_yx" in arrays:
        maps["T_yx"] = read_map(map_file, n_from=n_y, n_to=n_x, key="T_yx")
    if "C_yx" in arrays:
        maps["C_yx"] = arrays["C_yx"]
    return mesh_x, mesh_y, maps, truth


def _figures(mesh_x, mesh_y, maps, truth, exact, every) -> dict[str, float]:
    from jfsf import metrics
    from jfsf.spectrum import operators

    T_xy, T_yx, C_yx = (maps.get(name) for name in ("T_xy", "T_yx", "C_yx"))
    figures: dict[str, Any] = {}
    with Progress(console=Console(stderr=True), transient=True) as bars:

        def bar(text):
            task = bars.add_task(text, total=None)
            return lambda done, total: bars.update(task, completed=done, total=total)

        if truth is not None:
            points = (side[::every] for side in truth)
            error = metrics.geodesic_error(
                T_xy, mesh_y, *points, exact=exact, progress=bar("geodesic error")
            )
            figures["error_mean"] = error.mean()
            figures["error_median"] = np.median(error)
            figures["error_max"] = error.max()
            shares = metrics.error_curve(error, THRESHOLDS)
            for limit, share in zip(THRESHOLDS, shares, strict=True):
                figures[f"share_within_{limit}"] = share
            figures["auc_0.25"] = metrics.auc(error, limit=0.25)
        ways = {"x": (T_xy, T_yx, mesh_x), "y": (T_yx, T_xy, mesh_y)}
        for name, (there, back, mesh) in ways.items() if T_yx is not None else ():
            away = metrics.bijectivity(
                there,
                back,
                mesh,
                at=np.arange(0, len(mesh.vertices), every),
                exact=exact,
                progress=bar(f"bijectivity on {name.upper()}"),
            )
            figures[f"bijectivity_{name}"] = away.mean()
    (stiffness_x, mass_x), (_, mass_y) = operators(mesh_x), operators(mesh_y)
    figures["coverage_xy"] = metrics.coverage(T_xy, mass_y)
    if T_yx is not None:
        figures["coverage_yx"] = metrics.coverage(T_yx, mass_x)
    figures["smoothness"] = metrics.smoothness(T_xy, mesh_y.vertices, stiffness_x)
    if C_yx is not None:
        figures["orthogonality"] = metrics.orthogonality(C_yx)
        figures["zoomout_energy"] = metrics.zoomout_energy(C_yx)
    return {name: float(value) for name, value in figures.items()}


if __name__ == "__main__":
    main()
