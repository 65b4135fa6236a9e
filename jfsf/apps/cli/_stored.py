"""Maps as they are written, and read again with their meshes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.apps.cli._files import Shape, kept_points
from jfsf.apps.cli._options import check_truth
from jfsf.types import Match, Mesh


def write_found(
    path: Path, match: Match, x: Shape, y: Shape, notes: Sequence[str] = ()
) -> None:
    """Write a match; after a repair its maps are those between the files' vertices."""
    from jfsf.apps.mapfiles import write_match
    from jfsf.mesh._partners import map_of_originals, nearest_kept

    if x.repaired is None and y.repaired is None:
        write_match(path, match, index_x=x.index, index_y=y.index, notes=notes)
        return
    both = _repaired(x), _repaired(y)
    match = match._replace(
        T_xy=map_of_originals(match.T_xy, x.file, *both),
        T_yx=map_of_originals(match.T_yx, y.file, *both[::-1]),
    )
    at = [nearest_kept(s.file, own) for s, own in zip((x, y), both, strict=True)]
    write_match(path, _values_at(match, *at), notes=notes)


def kept_match(match: Match, x: Shape, y: Shape) -> Match:
    """The match of the shapes from that of their files, as `write_found` wrote it."""
    if x.repaired is None and y.repaired is None:
        return match
    one, two = _repaired(x), _repaired(y)
    match = match._replace(
        T_xy=two.partner[np.asarray(match.T_xy)[one.index]],
        T_yx=one.partner[np.asarray(match.T_yx)[two.index]],
    )
    return _values_at(match, one.index, two.index)


def _repaired(shape: Shape):
    """The repair of a shape; of one that is whole, that nothing was removed."""
    from jfsf.mesh import Repaired

    same = np.arange(len(shape.file.vertices), dtype=np.int32)
    return shape.repaired or Repaired(shape.mesh, same, same, ())


def _values_at(match: Match, at_x, at_y) -> Match:
    """The values of vertices, where there are any, at these vertices of X and of Y."""
    kinds = "matched", "confidence", "radius", "membership"
    names = [f"{name}_{side}" for name in kinds for side in "xy"]
    known = [name for name in names if getattr(match, name) is not None]
    at = {"x": at_x, "y": at_y}
    return match._replace(
        **{n: np.asarray(getattr(match, n))[at[n[-1]]] for n in known}
    )


def stored_match(path: Path) -> Match | None:
    """The match in a file of match; None of another map."""
    from jfsf.apps.mapfiles import MapFileError, read_match

    try:
        return read_match(path)
    except MapFileError:
        return None


def read_pair(
    x, y, map_file, gt_x, gt_y, base, mend=False
) -> tuple[Mesh, Mesh, Any, Any]:
    """Both meshes, the arrays of the map file, and the ground truth or None.

    A map of `match --largest-component` counts the vertices that were kept. Then the
    meshes are cut to these, and points of the ground truth that were not kept are left
    out; so are those that a match of parts leaves out. With `mend` the meshes are
    repaired, and the map becomes one between these.
    Else vertices without a face are left out, to which no distance is finite.
    """
    from jfsf.apps.mapfiles import read_ground_truth
    from jfsf.apps.mapfiles._stored import read_stored
    from jfsf.mesh import read_noted

    check_truth(gt_x, gt_y)
    meshes = [read_noted(path, finite=not mend).mesh for path in (x, y)]
    sizes = {
        f"n_{side}": len(mesh.vertices) for side, mesh in zip("xy", meshes, strict=True)
    }
    truth = None
    if gt_x is not None:
        truth = read_ground_truth(gt_x, gt_y, **sizes, base=base)
    maps = read_stored(map_file, **sizes, base=base)
    partners: list[Any] = [None, None]
    if mend:
        meshes, maps, partners[:] = _mended_pair(meshes, maps, (x, y))
    else:
        for side, index in enumerate((maps.index_x, maps.index_y)):
            if index is not None:
                vertices, faces = meshes[side]
                new = np.full(len(vertices), -1, np.int32)
                new[index] = np.arange(len(index))
                faces = new[faces]
                meshes[side] = Mesh(vertices[index], faces[(faces >= 0).all(1)])
                partners[side] = new
        if maps.index_x is None and maps.index_y is None:
            meshes, maps, partners[:] = _pair_without_strays(meshes, maps)
    if truth is not None:
        match = stored_match(map_file)
        inside = None if match is None else match.matched_x
        if inside is not None and len(inside) == sizes["n_x"]:
            matched = np.asarray(inside)[truth[0]]
            truth = truth[0][matched], truth[1][matched]
        truth = kept_points(truth, partners)
    return meshes[0], meshes[1], maps, truth


def _mended_pair(meshes, maps, paths):
    """The meshes repaired, the maps between these, and the partners of the vertices."""
    from jfsf.mesh import repair

    if maps.index_x is not None or maps.index_y is not None:
        raise ValueError(
            "--repair is for maps between all vertices of the files, and this one is "
            "of match --components, or of --largest-component without --repair; leave "
            "the option out"
        )
    x, y = (
        repair(mesh, name=str(path)) for mesh, path in zip(meshes, paths, strict=True)
    )
    T_xy = y.partner[maps.T_xy[x.index]]
    T_yx = None if maps.T_yx is None else x.partner[maps.T_yx[y.index]]
    for path, T in zip(paths[::-1], (T_xy, T_yx), strict=True):
        if T is not None and (T < 0).any():
            raise ValueError(
                f"--repair: the map names vertices of {path} that the repair removes; "
                "match with --repair too"
            )
    return [x.mesh, y.mesh], maps._replace(T_xy=T_xy, T_yx=T_yx), (x.partner, y.partner)


def _pair_without_strays(meshes, maps):
    """The meshes without vertices that have no face, the maps and partners likewise.

    An image without a face becomes the nearest vertex with one.
    """
    from jfsf.mesh import without_strays
    from jfsf.mesh._partners import nearest_kept

    x, y = both = [without_strays(mesh) for mesh in meshes]
    if not (x.done or y.done):
        return meshes, maps, (None, None)
    near_x, near_y = map(nearest_kept, meshes, both)
    T_xy = near_y[maps.T_xy[x.index]]
    T_yx = None if maps.T_yx is None else near_x[maps.T_yx[y.index]]
    maps = maps._replace(T_xy=T_xy, T_yx=T_yx)
    return [x.mesh, y.mesh], maps, (x.partner, y.partner)


def of_kept(matched: np.ndarray, file: Mesh, kept: Mesh) -> np.ndarray:
    """Whether vertices of what was kept are matched, from those of the file or its."""
    if len(matched) == len(kept.vertices):
        return matched
    return matched[_nearest_vertex(file, kept)]


def _nearest_vertex(mesh: Mesh, points: Mesh) -> np.ndarray:
    """The vertex of a mesh nearest to each vertex of another, which is finite."""
    from scipy.spatial import KDTree

    finite = np.flatnonzero(np.isfinite(mesh.vertices).all(1))
    tree = KDTree(np.asarray(mesh.vertices)[finite])
    return finite[np.asarray(tree.query(points.vertices)[1])]
