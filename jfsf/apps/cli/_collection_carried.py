"""What `jfsf collection` carries from the template, and landmarks as they are read."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.apps.cli._collection_jobs import file_of
from jfsf.types import ArrayLike, Mesh

SLICER = ".mrk.json"  # Slicer takes a file that ends in .json alone for no landmarks


def points_of(landmarks: Path | None, template: Path | None):
    """The landmarks as points of the template; None without any.

    Their vertices, if they are such, are those of its file: of what is kept of it they
    would be others.
    """
    from jfsf.apps.landmarks import read_landmarks
    from jfsf.apps.landmarks._place import NEAR, on_surface
    from jfsf.apps.landmarks._record import titled
    from jfsf.mesh import read

    if landmarks is None or template is None:
        return None
    found = read_landmarks(landmarks)
    mesh = read(template, finite=False)  # --repair leaves them out
    try:
        at = on_surface(found, mesh)
    except ValueError as error:
        raise ValueError(f"{landmarks}: {error}") from None
    if found.vertices is None:
        away = np.asarray(at.distances)
        worst = int(away.argmax())
        corners = np.asarray(mesh.vertices, float)
        corners = corners[np.isfinite(corners).all(1)]
        share = away[worst] / np.linalg.norm(np.ptp(corners, axis=0))
        if share <= NEAR:
            return found
        far = (
            f"{titled(found.names, worst)} is {away[worst]:.3g} from the template, "
            f"{share:.1%} of the diagonal of its bounding box: is it the file of "
            "another mesh? The nearest points are taken"
        )
        return found._replace(said=(*found.said, far))
    return found._replace(points=at.points, vertices=None)


class Carried(NamedTuple):
    """A file of the template.

    what: "labels" or "values"; the folder of the results has that name.
    suffix: of the file, and of the results.
    column: what it has for each vertex or face (`Column`).
    """

    what: str
    suffix: str
    column: ArrayLike


def carried_of(template: Path | Mesh | None, **files: Path | None) -> list[Carried]:
    """The files to carry, read and checked against the template.

    Args:
        template: its file, or the mesh of it.
        files: labels and values, by these names; None where there is none.

    Raises:
        ValueError: as `read_labels` and `read_values`.
    """
    from jfsf.apps.transfer._files import read_labels, read_values
    from jfsf.mesh import read

    found = []
    for what, path in files.items():
        if path is None or template is None:
            continue
        is_mesh = isinstance(template, Mesh)
        # What is not finite is left out by --repair.
        mesh = template if is_mesh else read(template, finite=False)
        n, m = len(mesh.vertices), len(mesh.faces)
        is_labels = what == "labels"
        column = read_labels(path, n, m) if is_labels else read_values(path, n)
        found.append(Carried(what, path.suffix.lower(), column))
    return found


def write_carried(
    out: Path, rows, paths, shapes, template: str, carried, turned, source: Mesh
) -> list[Path]:
    """Write them for the vertices or faces of the file of each joined shape.

    Args:
        out: the folder of the results.
        rows: of the summary.
        paths, shapes: the file, and what was kept of it, by name.
        template: its name.
        carried: of `carried_of`.
        turned: names of the shapes that were mirrored back.
        source: the mesh of the template's file.

    Returns:
        The folders that were written to.
    """
    from jfsf.apps.registration import Registration
    from jfsf.apps.transfer import labels, values
    from jfsf.apps.transfer._files import write_column
    from jfsf.apps.transfer._overlay import extended, overlay_template
    from jfsf.mesh import read
    from jfsf.mesh._edit import mirror_image

    carry = {"labels": labels, "values": values}
    for one in carried:
        (out / one.what).mkdir(exist_ok=True)
    for row in rows:
        if not carried or row["reason"]:
            continue
        name = row["name"]
        with np.load(file_of(out, "registered", name)) as file:
            found = Registration(*(file[field] for field in Registration._fields))
        part = overlay_template(shapes[template].mesh, shapes[name].mesh, found)
        file = read(paths[name], finite=False)
        scan = mirror_image(file) if name in turned else file
        whole = extended(part, scan, source)
        for one in carried:
            result = one.column._replace(rows=carry[one.what](whole, one.column.rows))
            write_column(out / one.what / f"{name}{one.suffix}", result)
    return [out / one.what for one in carried]


def carried_files(out: Path, name: str) -> list[Path]:
    """The files of what was carried to a shape, landmarks included, that are there."""
    from jfsf.apps.landmarks._files import SUFFIXES
    from jfsf.apps.transfer._files import FORMATS, LABEL_FORMATS

    columns = {"labels": LABEL_FORMATS, "values": FORMATS}
    kinds = {"landmarks": (SLICER, *SUFFIXES), **columns}
    paths = [out / kind / f"{name}{end}" for kind in kinds for end in kinds[kind]]
    return [path for path in paths if path.exists()]
