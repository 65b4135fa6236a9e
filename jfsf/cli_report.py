"""What the command line says of a map: evidence, warnings, figures."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from jfsf.types import Certificate

THRESHOLDS = (0.01, 0.02, 0.05, 0.1)
# Of 752 maps the one wrong one is below, and 7 % of the right ones:
# experiments/calibration.py.
UNSURE = 0.07


def certificate_table(certificate: Certificate) -> Table:
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


def warnings_of(certificate: Certificate, orientation: str) -> list[str]:
    turned = float(certificate.orientation)
    right = {"preserve": turned, "reverse": -turned, "any": abs(turned)}[orientation]
    covered = min(float(certificate.coverage_xy), float(certificate.coverage_yx))
    away = max(float(certificate.bijectivity_x), float(certificate.bijectivity_y))
    found = {
        "a number is not finite: do not use this map": not bool(certificate.finite),
        f"orientation {turned:+.2f} is not what {orientation!r} asks for: left and "
        "right, or front and back, may be swapped; landmarks decide": right < 0.5,
        f"a map that really differs is only {float(certificate.gap):.1%} worse: look "
        "whether this one is flipped; landmarks decide": (
            float(certificate.gap) < UNSURE
        ),
        f"only {covered:.0%} of a shape is hit: the shapes may differ too much": (
            covered < 0.5
        ),
        f"there and back again ends {away:.2f} away: the maps disagree": away > 0.1,
        f"{int(certificate.empty)} vertices got no mass": bool(certificate.empty),
    }
    return [line for line, wrong in found.items() if wrong]


def figures_of(mesh_x, mesh_y, maps, truth, exact, every) -> dict[str, float]:
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
