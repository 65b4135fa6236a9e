"""Landmarks that people placed on shapes of `jfsf collection`, in a folder of files."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jfsf.mesh._read import stem_of


class ByPeople(NamedTuple):
    """Landmarks that people placed on a shape.

    path: of the file.
    rows: (p,) which landmarks of the template they are.
    points: (p, 3) in the coordinates of the shape's file.
    said: what was left out, a sentence each.
    """

    path: Path
    rows: np.ndarray
    points: np.ndarray
    said: list[str]


def landmark_files(folder: Path) -> dict[str, Path]:
    """The files of a folder in a format of landmarks, by their names without endings.

    Raises:
        ValueError: no folder, or two files of one name.
    """
    from jfsf.apps.landmarks._files import SUFFIXES

    if not folder.is_dir():
        raise ValueError(f"{folder}: is no folder; give one of landmark files")
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.suffix.lower() not in SUFFIXES:
            continue
        name = path.name.removesuffix(path.suffix)
        name = name[:-4] if name.lower().endswith(".mrk") else name
        if name in found:
            raise ValueError(f"{path}: has the name of {found[name]}; take one away")
        found[name] = path
    return found


def file_of_template(landmarks: Path | None, template: Path | None) -> Path | None:
    """The file of the template's landmarks: it may be in a folder, by its name.

    Raises:
        ValueError: a folder without it.
    """
    if landmarks is None or template is None or not landmarks.is_dir():
        return landmarks
    files, name = landmark_files(landmarks), stem_of(template)
    if name not in files:
        raise ValueError(
            f"{landmarks}: has no landmarks of the template, such as {name}.fcsv; it "
            f"has {_some(files)}"
        )
    return files[name]


def placed_by_people(
    folder: Path | None, paths, landmarks, sliding=()
) -> dict[str, ByPeople]:
    """The landmark files of a folder that are named as shapes, by these names.

    Args:
        folder: of files in any format of landmarks; others are passed over. None for
            no folder.
        paths: the file of each shape, by name.
        landmarks: of the template; None if there are none.
        sliding: numbers of those, from 0, that people need not place.

    Raises:
        ValueError: no template's landmarks, no folder, no such file, two of one shape,
            a file that cannot be read, landmarks that are not those of the template, or
            far from the shape.
    """
    from jfsf.apps.landmarks import pair_landmarks, read_landmarks
    from jfsf.apps.landmarks._pairs import _listed
    from jfsf.apps.landmarks._place import as_points
    from jfsf.mesh import read

    if folder is None:
        return {}
    if landmarks is None:
        raise ValueError(
            f"{folder}: the same landmarks are needed on the template; give --template "
            "and --landmarks"
        )
    files, found = landmark_files(folder), {}
    for name in [name for name in files if name in paths]:
        path = files[name]
        marks = read_landmarks(path)
        try:
            mesh = read(paths[name], finite=False)
        except (ValueError, OSError):  # it is left out, and then named with the reason
            continue
        try:
            marks = as_points(marks, mesh)
            pairs = pair_landmarks(landmarks, marks)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        points = np.asarray(marks.points, float)
        of_template, own = pairs.rows.T
        no = {*of_template.tolist(), *sliding}
        lacking = [name for i, name in enumerate(landmarks.names) if i not in no]
        others = [name for i, name in enumerate(marks.names) if i not in own]
        said = [f"{path}: {line}" for line in marks.said]
        if lacking:
            said.append(f"{path}: has no landmark {_listed(lacking)}")
        if others:
            said.append(f"{path}: the template has no landmark {_listed(others)}")
        found[name] = ByPeople(path, of_template, points[own], said)
    if not files.keys() & paths.keys():
        raise ValueError(
            f"{folder}: has no landmark file that is named as a shape, such as "
            f"{next(iter(paths))}.fcsv; it has {_some(files)}"
        )
    return found


def _some(files: dict[str, Path]) -> str:
    """Up to five names of files."""
    return ", ".join(path.name for path in [*files.values()][:5]) or "none"


def mirrored_with(people: dict[str, ByPeople], turned) -> dict[str, ByPeople]:
    """What people placed, mirrored in x on shapes that were mirrored back.

    Args:
        people: by names of shapes.
        turned: names of the shapes that were mirrored back.
    """
    return {
        name: own._replace(points=own.points * [-1, 1, 1]) if name in turned else own
        for name, own in people.items()
    }
