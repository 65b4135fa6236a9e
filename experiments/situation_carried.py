"""Rows of situations.py on what is carried along a map, here the true one.

As `situation_reading.py`; `CARRIED` names the makers.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from situation_files import NAMES, Contents, landmark_vertices
from situation_formats import obj, write, write_landmarks
from situation_runs import (
    OTHER,
    PAIR,
    Check,
    Command,
    FileSituation,
    bodies,
    true_maps,
)
from transfer import parts_of, true_map

from jfsf.apps.landmarks import read_landmarks
from jfsf.mesh import check, closest, read, read_uv, surface_area
from jfsf.mesh._closest import surface_tree


def carried(folder: Path) -> list[Command]:
    """Labels, values, landmarks and a texture of Y, for X."""
    x, y = bodies()
    write(folder / "x.off", x.mesh)
    write(folder / "y.off", y.mesh)
    args = ("transfer", "x.off", "y.off", true_maps(folder, x, y))
    unit, T_xy = np.sqrt(surface_area(x.mesh)), true_map(x.body, y.body)
    (of_x, _), (of_y, _) = parts_of(x.body), parts_of(y.body)
    np.savetxt(folder / "labels.txt", of_y, "%d")
    np.save(folder / "places.npy", y.mesh.vertices)
    wrong = lambda: float((np.loadtxt(folder / "x_labels.txt") != of_x).mean())
    away = lambda points, places: float(
        np.linalg.norm(points - places, axis=1).mean() / unit
    )
    values = lambda: away(np.load(folder / "x_places.npy"), y.mesh.vertices[T_xy])
    found = [
        Command(
            "labels",
            (*args, "--labels", "labels.txt", "--out", "x_labels.txt"),
            checks={"labels that are wrong": Check(wrong, 0.04)},
        ),
        Command(
            "values",
            (*args, "--values", "places.npy", "--out", "x_places.npy"),
            checks={"error": Check(values, 0.04)},
        ),
    ]
    for suffix in (".mrk.json", ".fcsv", ".pp", ".csv"):
        write_landmarks(folder / f"y{suffix}", y)

        def error(out=f"x{suffix}"):
            marks = read_landmarks(folder / out)
            at = landmark_vertices(x)[[NAMES.index(name) for name in marks.names]]
            return away(marks.points, x.mesh.vertices[at])

        own = (*args, "--landmarks", f"y{suffix}", "--out", f"x{suffix}")
        checks = {"error": Check(error, 0.04)}
        found.append(Command(f"landmarks, {suffix}", own, checks=checks))
    return [*found, _texture(folder, x, y, args)]


def _texture(folder: Path, x: Contents, y: Contents, args) -> Command:
    """An image whose colours are its coordinates, laid on Y from the front."""
    points = y.mesh.vertices
    size = np.ptp(points, axis=0)
    uv = ((points - points.min(0)) / size)[:, :2]
    text = obj(points.tolist(), y.mesh.faces.tolist(), uv=uv.tolist())
    (folder / "y.obj").write_text(text, encoding="utf-8")
    steps = (np.arange(256) + 0.5).astype(np.uint8)
    u, v = np.meshgrid(steps, steps[::-1])
    Image.fromarray(np.stack([u, v, 0 * u], 2)).save(folder / "skin.png")
    T_xy = true_map(x.body, y.body)

    def error():
        path = folder / "x_textured.obj"
        mesh = read(path)
        image = np.asarray(Image.open(path.with_suffix(".png")))
        u, v = np.asarray(read_uv(path, mesh)).mean(1).T
        width = len(image)
        pixel = image[((1 - v) * width).astype(int), (u * width).astype(int), :2]
        true = uv[T_xy[mesh.faces]].mean(1)
        away = np.linalg.norm((pixel / 255 - true) * size[:2], axis=1).mean()
        return float(away / np.sqrt(surface_area(y.mesh)))

    own = ("--texture", "skin.png", "--size", "1024", "--out", "x_textured.obj")
    args = (*args[:2], "y.obj", *args[3:], *own)
    return Command("a texture", args, checks={"error": Check(error, 0.04)})


def registered(folder: Path) -> list[Command]:
    """A template that is to lie on a scan."""
    found = []
    for names in (PAIR, OTHER):
        x, y = bodies(names)
        for side, own in (("template", x), ("scan", y)):
            write(folder / f"{names[0]}_{side}.ply", own.mesh)
        out = f"{names[0]}_registered.ply"
        args = [f"{names[0]}_{side}.ply" for side in ("template", "scan")]
        tree, unit = surface_tree(y.mesh), np.sqrt(surface_area(y.mesh))

        def distance(path=folder / out, tree=tree, unit=unit):
            return float(closest(tree, read(path).vertices).distance.mean() / unit)

        def collapsed(path=folder / out):
            mesh = read(path)
            return (check(mesh).degenerate_faces or 0) / len(mesh.faces)

        checks = {
            "distance": Check(distance, 0.005),
            "collapsed faces": Check(collapsed, 0.001),
        }
        args = (
            "register",
            *args,
            "--map",
            true_maps(folder, x, y, names[0]),
            "--out",
            out,
        )
        found.append(Command(names[0], args, ("flipped faces",), checks=checks))
    return found


CARRIED = {
    "carried": FileSituation(
        "labels, values, landmarks or a texture of Y that X is to have",
        "carries them along the map, between vertices too; a texture gets a new image",
        "`jfsf transfer X Y map.npz`",
        carried,
    ),
    "a template on a scan": FileSituation(
        "a template that is to lie on a scan",
        "deforms it; no faces collapse, as they do if its vertices take the places of "
        "their images",
        "`jfsf register TEMPLATE SCAN --out FILE`",
        registered,
    ),
}
