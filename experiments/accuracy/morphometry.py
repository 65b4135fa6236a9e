"""Landmarks that maps carry, beside those of experts: errors, and the shape space.

`jfsf collection` runs on the shapes of a set with the experts' landmarks of one of
them, the template, in FOLDER, which is kept: run it again to go on. The template is the
most central shape by its spectrum, so no landmark chooses it. Of each other specimen,
in percent of its centroid size, the mean error of

- `pair`: `jfsf.match` of the template and the specimen alone, and `jfsf.register`;
- `collection`: the command; and `templates`: with --templates 3;
- `people`: the same three templates, each with the experts' own landmarks, on the
  specimens that are none of them (`on_the_rest` has all ways there);
- `cpd`: deformable coherent point drift as ALPACA does it (Porto, Rolfe and Maga 2021;
  Myronenko and Song 2010; pycpd), from the similarity that best fits the map `pair`,
  which flatters it; then to the nearest point of the surface;
- `similarity`: what the best similarity of the experts' own landmarks leaves, the least
  that a method which does not deform can have;
- `tps`: each landmark by the thin-plate spline of all others of the experts. It knows
  the specimen's own landmarks, as nobody has who is looking for them.

`space` has of each way how its landmarks and the experts' agree: the correlation of the
Procrustes distances between specimens, of the scores along the experts' first
components, and the mean distance over the experts'. Landmarks that slide to where the
template has them shrink it. `radius` has the share of errors within the radius of 90 %,
and the rank correlation of the two.

    python -m experiments.accuracy.morphometry calcanei FOLDER --data ROOT
"""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist, pdist
from scipy.stats import rankdata

import jfsf
from experiments import command_line, results_file
from experiments.accuracy.collection import shapes_of, write_off
from jfsf.apps.collections import unlikeness
from jfsf.apps.collections._cycles import sketch
from jfsf.apps.landmarks import Landmarks, read_specimens, write_landmarks
from jfsf.apps.landmarks._place import nearest
from jfsf.apps.morphometrics import procrustes, warp
from jfsf.apps.morphometrics._procrustes import centroid_size, similarity

TEMPLATES = 3
COMPONENTS = 3
# ALPACA's: points of each shape, stiffness, width in units of the root mean square
# distance from the centroid; and iterations of pycpd.
POINTS, LAMBDA, BETA, ITERATIONS = 1500, 2.0, 2.0, 100

Points = Float[np.ndarray, "l 3"]


def main() -> None:
    parser = command_line.parser(__doc__, data=True)
    parser.add_argument("set", help="of the protocol, with listed landmarks")
    parser.add_argument("folder", type=Path)
    args = command_line.parse(parser)
    shapes = shapes_of(args.set, args.data)
    truth = {
        name: np.asarray(own.mesh.vertices, float)[own.truth]
        for name, own in shapes.items()
    }
    meshes = {name: own.mesh for name, own in shapes.items()}
    base = central(meshes)
    on_base = args.folder / f"{base}.csv"
    for name, mesh in meshes.items():
        path = args.folder / "scans" / f"{name}.off"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_off(path, mesh)
    names = tuple(str(i) for i in range(1, len(truth[base]) + 1))
    write_landmarks(on_base, Landmarks(names, truth[base], None, None))
    by_pair = {name: by_map(meshes, truth, base, name) for name in meshes}
    one, radius = collected(args.folder, base, on_base)
    several, of_several = collected(args.folder, base, on_base, TEMPLATES)
    ways = {"pair": by_pair, "collection": one, "templates": several}
    given = {base, *(path.name for path in (args.folder / "model/templates").iterdir())}
    placed = args.folder / "given"
    placed.mkdir(exist_ok=True)
    for name in given:
        own = Landmarks(names, truth[name], None, None)
        write_landmarks(placed / f"{name}.csv", own)
    people, of_people = collected(args.folder, base, placed)
    rest = [name for name in people if name not in given]
    ways |= {
        "people": {name: people[name] for name in rest},
        "cpd": {n: drifted(meshes, truth, base, n, by_pair[n]) for n in meshes},
        "similarity": {n: similar(truth[base], own) for n, own in truth.items()},
        "tps": {n: left_out(truth[base], own) for n, own in truth.items()},
    }
    rows = [
        {"specimen": name, **{way: error(ways[way].get(name), own) for way in ways}}
        for name, own in truth.items()
        if name != base
    ]
    summary = {
        "template": base,
        "specimens": len(rows),
        "landmarks": len(names),
        **means(rows, ways),
        "on_the_rest": means([r for r in rows if r["specimen"] not in given], ways),
        "radius": {
            "collection": held(one, radius, truth, [n for n in one if n != base]),
            "templates": held(
                several, of_several, truth, [n for n in several if n != base]
            ),
            "people": held(people, of_people, truth, rest),
        },
        "space": {
            way: space(ways[way], truth)
            for way in ("pair", "collection", "templates", "cpd")
        },
    }
    print(json.dumps(summary, indent=1))
    out = args.out or command_line.RESULTS / f"morphometry_{args.set}.json"
    settings = {"set": args.set, "templates": TEMPLATES, "points of cpd": POINTS}
    results_file.write(out, settings=settings, summary=summary, specimens=rows)


def central(meshes: dict[str, jfsf.Mesh]) -> str:
    """The shape whose spectrum differs least from the others'."""
    signatures = [sketch(jfsf.basis(mesh)).signature for mesh in meshes.values()]
    return list(meshes)[int(unlikeness(signatures).mean(1).argmin())]


def by_map(meshes, truth, base: str, name: str) -> Points:
    """The template's landmarks by one match and registration."""
    if name == base:
        return truth[base]
    T_xy = jfsf.match(meshes[base], meshes[name]).T_xy
    on_shape = jfsf.register(meshes[base], meshes[name], T_xy)
    return nearest(meshes[base], truth[base]).on(on_shape.vertices)


def means(rows: list[dict], ways) -> dict[str, float]:
    """Over the specimens, of each way."""
    return {way: float(np.nanmean([row[way] for row in rows])) for way in ways}


def collected(
    folder: Path, base: str, landmarks: Path, templates: int = 1
) -> tuple[dict[str, Points], dict[str, Float[np.ndarray, " l"]]]:
    """The landmarks of the joined specimens, and their radii, by the command line."""
    out = folder / "model"  # with more templates the same run goes on
    command = [sys.executable, "-m", "jfsf", "collection", folder / "scans"]
    command += ["--out", out, "--template", folder / "scans" / f"{base}.off"]
    command += ["--landmarks", landmarks]
    command += ["--templates", templates] if templates > 1 else []
    subprocess.run(list(map(str, command)), check=False)
    found = read_specimens(out / "landmarks.csv")
    with open(out / "landmarks_radius.csv", encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    number = lambda cell: np.nan if cell == "NA" else float(cell)
    radius = {row[0]: np.array(list(map(number, row[1:]))) for row in rows}
    return dict(zip(found.specimens, found.points, strict=True)), radius


def held(points, radius, truth, names) -> dict[str, float]:
    """How well the radii of these specimens hold the errors, and rank them."""
    away = [np.linalg.norm(points[n] - truth[n], axis=1) for n in names]
    far, reach = np.concatenate(away), np.concatenate([radius[n] for n in names])
    known = np.isfinite(far) & np.isfinite(reach)
    rank = np.corrcoef(rankdata(far[known]), rankdata(reach[known]))[0, 1]
    return {"within": float((far <= reach)[known].mean()), "rank": float(rank)}


def drifted(meshes, truth, base: str, name: str, start: Points) -> Points:
    """The template's landmarks by coherent point drift onto a specimen."""
    from pycpd import DeformableRegistration

    if name == base:
        return truth[base]
    scale, turn, shift = similarity(truth[base], start)
    move = lambda points: scale * points @ turn + shift
    rng = np.random.default_rng(0)
    x, y = (np.asarray(meshes[n].vertices, float) for n in (base, name))
    some = lambda points: points[rng.permutation(len(points))[:POINTS]]
    centre, unit = y.mean(0), np.sqrt(((y - y.mean(0)) ** 2).sum(1).mean())
    goal, source = (some(y) - centre) / unit, (some(move(x)) - centre) / unit
    given = {"alpha": LAMBDA, "beta": BETA, "max_iterations": ITERATIONS}
    drift = DeformableRegistration(X=goal, Y=source, **given)
    drift.register()
    landmarks = (move(truth[base]) - centre) / unit
    kernel = np.exp(-cdist(landmarks, source, "sqeuclidean") / (2 * BETA**2))
    moved = (landmarks + kernel @ drift.W) * unit + centre
    return nearest(meshes[name], moved).points


def similar(points: Points, onto: Points) -> Points:
    """Landmarks by the similarity that fits them best."""
    scale, turn, shift = similarity(points, onto)
    return scale * points @ turn + shift


def left_out(points: Points, onto: Points) -> Points:
    """Each landmark by the thin-plate spline of all others."""
    found = np.full_like(onto, np.nan)
    if len(points) < 6:  # the others do not make a spline
        return found
    for i in range(len(points)):
        rest = np.arange(len(points)) != i
        found[i] = warp(points[i : i + 1], points[rest], onto[rest])[0]
    return found


def error(points: Points | None, truth: Points) -> float:
    """Mean distance, in percent of the centroid size of the true landmarks."""
    if points is None:
        return np.nan
    mean = np.nanmean(np.linalg.norm(points - truth, axis=1))
    return float(100 * mean / centroid_size(truth))


def space(points: dict[str, Points], truth: dict[str, Points]) -> dict:
    """How the shapes of landmarks agree with those of the experts."""
    names = [n for n in truth if n in points and np.isfinite(points[n]).all()]
    own, wanted = (
        procrustes(np.stack([of[n] for n in names])).shapes for of in (points, truth)
    )
    far = [pdist(rows.reshape(len(names), -1)) for rows in (own, wanted)]
    # Each about its own mean, in one frame.
    _, turn, _ = similarity(own.mean(0), wanted.mean(0))
    flat = [(r - r.mean(0)).reshape(len(names), -1) for r in (own @ turn, wanted)]
    modes = np.linalg.svd(flat[1], full_matrices=False)[2][:COMPONENTS]
    scores = [rows @ modes.T for rows in flat]
    return {
        "specimens": len(names),
        "distances": float(np.corrcoef(far[0], far[1])[0, 1]),
        "scores": [
            float(np.corrcoef(a, b)[0, 1])
            for a, b in zip(*(s.T for s in scores), strict=True)
        ],
        "mean distance over the experts'": float(far[0].mean() / far[1].mean()),
    }


if __name__ == "__main__":
    main()
