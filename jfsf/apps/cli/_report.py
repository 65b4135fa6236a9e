"""Reports on one map: its certificate as a table, and its figures."""

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from jfsf.apps.report._words import readings
from jfsf.types import Certificate

ERROR_LIMITS = (0.01, 0.02, 0.05, 0.1)  # geodesic over sqrt(area), for the curve


def certificate_table(certificate: Certificate) -> Table:
    """A table with a row for each figure of the certificate, and what it means."""
    shown = Table(title="certificate: evidence without ground truth")
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    shown.add_column("reading")
    for name, (value, reading) in readings(certificate).items():
        shown.add_row(name, value, reading)
    return shown


def figures_of(mesh_x, mesh_y, maps, truth, exact, every) -> dict[str, float]:
    """The figures of a map that can be measured, by name; a bar shows the progress."""
    from jfsf.evaluate import auc, error_curve, evaluate

    with Progress(console=Console(stderr=True), transient=True) as bars:
        tasks = {}

        def show(name, done, total):
            if name not in tasks:
                tasks[name] = bars.add_task(name.replace("_", " "), total=total)
            bars.update(tasks[name], completed=done, total=total)

        measured = evaluate(
            maps,
            mesh_x,
            mesh_y,
            truth=truth,
            every=every,
            exact=exact,
            progress=show,
        )
    figures: dict[str, float] = {}
    errors = measured.error[~np.isnan(measured.error)]
    for name, value in measured._asdict().items():
        # How many points were left out is no figure of the map.
        if name not in ("error", "error_left_out") and not np.isnan(value):
            figures[name] = value
        if name == "error_max" and len(errors):
            shares = error_curve(errors, ERROR_LIMITS)
            for limit, share in zip(ERROR_LIMITS, shares, strict=True):
                figures[f"share_within_{limit}"] = float(share)
            figures["auc_0.25"] = auc(errors, limit=0.25)
    return figures
