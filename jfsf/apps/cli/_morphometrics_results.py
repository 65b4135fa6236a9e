"""The results of `jfsf morphometrics`: tables, the ends of components, and pictures."""

from pathlib import Path
from typing import Any

import numpy as np

from jfsf.apps.cli._morphometrics_compared import Compared
from jfsf.apps.export import export_mesh
from jfsf.apps.landmarks import Landmarks, write_landmarks
from jfsf.apps.landmarks._morphometrics import Specimens, specimens_csv
from jfsf.apps.landmarks._record import csv_text
from jfsf.apps.morphometrics._draw import draw_allometry, draw_components
from jfsf.apps.morphometrics._statistics import Allometry
from jfsf.storage._atomic import write_text

# Not in every run: those of an earlier one are removed.
OPTIONAL = "symmetric.csv", "asymmetric.csv", "allometry.csv", "allometry.png"


def write_results(
    out: Path,
    found: Specimens,
    own: Specimens,
    compared: Compared,
    title: str,
    groups: list[str],
) -> list[Path]:
    """Write tables, shapes and pictures; returns what was written.

    Args:
        out: the folder; made if it is not there.
        found: the specimens.
        own: with the landmarks of their symmetric shapes.
        compared: of `compare`.
        title: of the column of groups; "" without.
        groups: of each specimen; "" for one without.
    """
    folder = out / "shapes"
    folder.mkdir(parents=True, exist_ok=True)
    texts = _texts(found, own, compared, {title: groups} if title else {})
    for name in OPTIONAL:
        if name not in texts:
            (out / name).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(out / name, text)
    for name, shape in compared.ends.items():
        write_landmarks(folder / f"{name}.fcsv", Landmarks(own.landmarks, shape))
        (folder / f"{name}.ply").unlink(missing_ok=True)
        if name in compared.meshes:
            export_mesh(folder / f"{name}.ply", compared.meshes[name])
    written = [*(out / name for name in texts), folder, out / "components.png"]
    shown = found.specimens, groups
    draw_components(written[-1], compared.modes, *shown)
    if not isinstance(compared.allometry, str):
        written.append(out / "allometry.png")
        draw_allometry(written[-1], compared.allometry, compared.aligned.sizes, *shown)
    return written


def _texts(found, own, compared: Compared, scores: dict[str, Any]) -> dict[str, str]:
    """The text of each table, by its name; `scores` are the first columns of theirs."""
    aligned, parts, modes = compared.aligned, compared.parts, compared.modes
    names, by_size = found.specimens, compared.allometry
    columns = {
        "centroid_size": aligned.sizes,
        "log_centroid_size": np.log(aligned.sizes),
        "distance": aligned.distances,
        "estimated": np.isnan(found.points).all(2).sum(1),
    }
    scores |= {f"PC{k}": column for k, column in enumerate(modes.scores.T, 1)}
    texts = {"aligned.csv": specimens_csv(names, found.landmarks, aligned.shapes)}
    if parts is not None:
        columns["asymmetry"] = parts.distances
        for what in ("symmetric", "asymmetric"):
            points = getattr(parts, what)
            texts[f"{what}.csv"] = specimens_csv(names, own.landmarks, points)
    if not isinstance(by_size, str):
        scores["regression_score"] = by_size.scores
        texts["allometry.csv"] = _table(_anova(by_size, len(names)))
    texts["sizes.csv"] = _table({"specimen": names} | columns)
    texts["scores.csv"] = _table({"specimen": names} | scores)
    number = range(1, 1 + len(modes.share))
    spread = {"component": number, "variance": modes.variance, "share": modes.share}
    return texts | {"components.csv": _table(spread)}


def _anova(found: Allometry, specimens: int) -> dict[str, list]:
    """The columns of the table of the regression, as geomorph's procD.lm has them."""
    free = [1, specimens - 2, specimens - 1]
    return {
        "source": ["log_centroid_size", "residuals", "total"],
        "Df": free,
        "SS": list(found.sums),
        "MS": [found.sums[0], found.sums[1] / free[1], ""],
        "Rsq": [found.share, 1 - found.share, ""],
        "F": [found.F, "", ""],
        "p": [found.p, "", ""],
        "orders": [found.orders, "", ""],
    }


def _table(columns: dict[str, Any]) -> str:
    return csv_text(list(columns), zip(*columns.values(), strict=True))
