"""Where shapes that are laid on each other make a better map: `Settings.rigid_below`.

Pairs are matched, and those that a similarity brings near once more from a stiff
deformation after it. For each: how far apart the surfaces lie then (`apart`), and the
error before and after. The table has the mean errors of the pairs below several limits.

The limit is chosen on SHREC'07, generated faces (`situations.py`) and heel bones;
molars and embedded bodies choose between limits that are about as good, and skulls are
only looked at. Of molars four landmarks are known. Heel bones and molars choose the
stiffness too: their rows have the error of nearest vertices after the field from X to
Y, for several (`stiffness`). Finished sets are read from --out.

    python -m experiments.fit.fit_rigid --data ROOT
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments import command_line, results_file
from experiments.accuracy import datasets, protocol
from experiments.accuracy.situations import faces
from jfsf.geometry import GeodesicSolver
from jfsf.matching import Settings
from jfsf.matching._match import attempted_pair
from jfsf.matching._rigid import laid_by_map, moved_by_map, surface_of
from jfsf.matching._stiff import nearest_alike, stiffly_onto
from jfsf.mesh import surface_area
from jfsf.types import Match, Mesh, Spectrum

STIFF_SETS = "calcanei", "hdm_molars"
SETS = *STIFF_SETS, "faces", "shrec07", "embedded", "mouse_skulls"
FACES, POINTS, WIDEST = 12, 500, 0.02
LIMITS = 0.003, 0.006, 0.008, 0.009, 0.01, 0.012, WIDEST
STIFFNESSES = 3e-5, 1e-4, 3e-4, 1e-3, 3e-3
Case = tuple[str, Mesh, Mesh, np.ndarray, np.ndarray]


def main() -> None:
    parser = command_line.parser(__doc__, out="fit_rigid.json", data="optional")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=SETS)
    args = command_line.parse(parser)
    found: dict[str, Any] = {}
    if args.out.exists():
        found = json.loads(args.out.read_text(encoding="utf-8"))["sets"]
    for name in args.sets:
        if name not in found:
            stiff = name in STIFF_SETS
            rows = [measure(*case, stiff) for case in cases(name, args.data)]
            near = [row for row in rows if row["apart"] is not None]
            found[name] = {"pairs": len(rows), "table": table(near), "near": near}
            if stiff:
                errors = np.mean([row["stiffness"] for row in near], 0)
                found[name]["stiffness"] = dict(zip(STIFFNESSES, errors, strict=True))
            settings = {"points": POINTS, "shipped": Settings().rigid_below}
            results_file.write(args.out, settings=settings, sets=found)
        print(name, found[name]["pairs"], *found[name]["table"], sep="\n", flush=True)


def cases(name: str, root: Path | None) -> Iterator[Case]:
    """Name, X, Y, and vertices of both that correspond."""
    if name == "faces":
        for case in faces(FACES):
            if case.truth is not None:
                yield case.name, case.x, case.y, *case.truth
        return
    data_set = protocol.SETS[name]
    if data_set.folders:
        if root is None:
            raise SystemExit("give --data ROOT or set JFSF_DATA")
        data_set = protocol.below(data_set, root)
    for pair in datasets.pairs_of(data_set):
        x, y = datasets.load_pair_of(data_set, pair)
        yield f"{pair.x} {pair.y}", x.mesh, y.mesh, x.truth, y.truth


def measure(
    name: str, x: Mesh, y: Mesh, at_x: np.ndarray, at_y: np.ndarray, stiff: bool
) -> dict:
    """A row: errors before and after; nothing where no motion brings X near."""
    settings = replace(Settings(), rigid_below=WIDEST)
    pair = attempted_pair(x, y, settings=settings)
    row: dict[str, Any] = {"pair": name, "apart": None}
    if pair.attempts[-1].source != "motion":
        print(row, flush=True)
        return row
    *others, after = pair.results(settings)
    before = max(others, key=lambda match: float(match.certificate.confidence))
    mirrors = bool(before.certificate.orientation < 0)
    moved = moved_by_map(*pair.spectra, np.asarray(before.T_xy), mirrors=mirrors)
    some = np.random.default_rng(0).permutation(len(at_x))[:POINTS]
    away = GeodesicSolver(y).rows(np.asarray(at_y)[some]) / np.sqrt(surface_area(y))
    error = lambda T_xy: float(
        away[np.arange(len(some)), np.asarray(T_xy)[at_x[some]]].mean()
    )
    row |= {"apart": moved and moved.apart}
    row |= {"before": error(before.T_xy), "after": error(after.T_xy)}
    if stiff:
        row["stiffness"] = [error(T) for T in by_stiffness(pair.spectra, before)]
    row |= {
        f"log_odds_{when}": float(match.certificate.log_odds)
        for when, match in (("before", before), ("after", after))
    }
    print(row, flush=True)
    return row


def by_stiffness(
    spectra: tuple[Spectrum, Spectrum], match: Match
) -> Iterator[np.ndarray]:
    """T_xy of nearest vertices that face alike, for each stiffness."""
    x, y = map(surface_of, spectra)
    mirrors = bool(match.certificate.orientation < 0)
    laid = laid_by_map(*spectra, np.asarray(match.T_xy), mirrors=mirrors)
    assert laid is not None
    for stiffness in STIFFNESSES:
        there = stiffly_onto(x, laid, y, mirrors=mirrors, stiffness=stiffness)
        yield nearest_alike(Mesh(there, x.faces), y, mirrors=mirrors)


def table(near: list[dict]) -> list[dict]:
    """Mean errors of the pairs that lie below each limit."""
    rows = []
    for limit in LIMITS:
        own = [row for row in near if row["apart"] < limit]
        mean = lambda key, own=own: float(np.mean([row[key] for row in own]))
        errors = {key: mean(key) for key in ("before", "after")} if own else {}
        rows.append({"limit": limit, "pairs": len(own), **errors})
    return rows


if __name__ == "__main__":
    main()
