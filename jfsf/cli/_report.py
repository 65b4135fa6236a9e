"""Reports on one map: its certificate as a table, its warnings, and its figures."""

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from jfsf.types import Certificate

ERROR_LIMITS = (0.01, 0.02, 0.05, 0.1)  # geodesic over sqrt(area), for the curve

# A figure of the certificate beyond one of these limits gives a warning.
# Of 154 first maps, cross-validated by data set, 3 of the 95 above 0.9 were wrong.
LIKELY = 0.9
DOUBTFUL = 0.7
# The score of right maps is about 0.9 and of mirrored ones about -0.9. Below half, a
# part of the shape is likely to be mirrored.
MIN_ORIENTATION = 0.5
# Right maps hit about 0.9 of the area. One that misses half of it has collapsed there.
MIN_COVERAGE = 0.5
# A tenth of the mean distance of two random vertices is many edges: beyond it the two
# maps contradict each other.
MAX_BIJECTIVITY = 0.1


def certificate_table(certificate: Certificate) -> Table:
    """A table with a row for each figure of the certificate, and what it means."""
    score = float(certificate.orientation)
    side = "keeps left and right" if score > 0 else "swaps left and right"
    if np.isnan(score):
        side = "unknown: a point cloud, or no winding"
    elif abs(score) < MIN_ORIENTATION:
        side = "unclear: parts may be flipped"
    readings = {
        "marginal_error": "transport plan's gap to its marginals; 0 is exact",
        "empty": "vertices that no mass reached",
        "coverage_xy": "share of Y's area that is hit",
        "coverage_yx": "share of X's area that is hit",
        "bijectivity_x": "mean distance, X to Y and back; 1 for random vertices",
        "bijectivity_y": "mean distance, Y to X and back",
        "orthogonality": "|C^T C - I|; 0 if areas are kept",
        "orientation": side,
        "gap": "extra energy of the second candidate, relative; 0 is a tie",
        "nn_agreement": "share that nearest neighbour maps alike",
        "finite": "every number is finite",
        "energy": "departure from an isometry",
        "unevenness": "how unevenly the map stretches; 0 for a similarity",
        "residual": "distance left between the bent shapes, in sqrt(area)",
        "distortion": "how much bending squeezes triangles; 0 for a similarity",
        "confidence": verdict(float(certificate.confidence)),
    }
    shown = Table(title="certificate: evidence without ground truth")
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    shown.add_column("reading")
    for name, value in certificate.figures().items():
        value = np.asarray(value)
        form = "+.2f" if name == "orientation" else ".4g"
        text = ("no", "yes")[int(value)] if value.dtype == bool else f"{value:{form}}"
        shown.add_row(name, text, readings.get(name, ""))
    return shown


def verdict(confidence: float) -> str:
    """The confidence of a certificate in words."""
    if np.isnan(confidence):
        return "unknown: the shapes were not sampled"
    if confidence >= LIKELY:
        return "very likely right"
    if confidence >= DOUBTFUL:
        return "probably right"
    return "doubtful" if confidence >= 0.5 else "probably wrong"


def warnings_of(certificate: Certificate, orientation: str) -> list[str]:
    """A line for each figure of the certificate that makes the map doubtful.

    Args:
        certificate: of one map.
        orientation: "preserve", "reverse" or "any", as the map was asked for.
    """
    score = float(certificate.orientation)
    agrees = {"preserve": score, "reverse": -score, "any": abs(score)}[orientation]
    likely = float(certificate.confidence)
    covered = min(float(certificate.coverage_xy), float(certificate.coverage_yx))
    away = max(float(certificate.bijectivity_x), float(certificate.bijectivity_y))
    found = {
        "a number is not finite: do not use this map": not bool(certificate.finite),
        f"orientation {score:+.2f} is not what {orientation!r} asks for: left and "
        "right, or front and back, may be swapped; landmarks decide": (
            agrees < MIN_ORIENTATION
        ),
        f"{verdict(likely)}, confidence {likely:.0%}: look at the picture; landmarks "
        "at hands, feet and head decide": likely < DOUBTFUL,
        f"only {covered:.0%} of a shape is hit: the shapes may differ too much": (
            covered < MIN_COVERAGE
        ),
        f"there and back again ends {away:.2f} away: the maps disagree": (
            away > MAX_BIJECTIVITY
        ),
        f"{int(certificate.empty)} vertices got no mass": bool(certificate.empty),
    }
    from jfsf.evaluate import MISSED

    far = np.flatnonzero(np.asarray(certificate.landmarks) > MISSED)
    for row in far:
        found[f"landmark {row + 1} ends far from its partner: check that row"] = True
    return [line for line, wrong in found.items() if wrong]


def figures_of(mesh_x, mesh_y, maps, truth, exact, every) -> dict[str, float]:
    """The figures of a map that can be measured, by name; a bar shows the progress."""
    from jfsf.evaluate import auc, error_curve, evaluate

    with Progress(console=Console(stderr=True), transient=True) as bars:
        tasks = {}

        def show(name, done, total):
            if name not in tasks:
                tasks[name] = bars.add_task(name.replace("_", " "), total=total)
            bars.update(tasks[name], completed=done, total=total)

        found = evaluate(
            maps,
            mesh_x,
            mesh_y,
            truth=truth,
            every=every,
            exact=exact,
            progress=show,
        )
    figures: dict[str, float] = {}
    for name, value in found._asdict().items():
        if name != "error" and not np.isnan(value):
            figures[name] = value
        if name == "error_max" and len(found.error):
            shares = error_curve(found.error, ERROR_LIMITS)
            for limit, share in zip(ERROR_LIMITS, shares, strict=True):
                figures[f"share_within_{limit}"] = float(share)
            figures["auc_0.25"] = auc(found.error, limit=0.25)
    return figures
