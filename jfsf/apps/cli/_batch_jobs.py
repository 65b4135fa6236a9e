"""The options of each pair of `jfsf batch`, and its jobs, which run in the workers.

The jobs: a spectrum a mesh, then a match a pair.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jfsf.apps.cli._files import matchable
from jfsf.apps.cli._known import kept_truth, known_pairs
from jfsf.apps.cli._options import check_pair
from jfsf.apps.cli._pair import (
    both_matchable,
    check_units,
    draw,
    find,
    notes_of,
    pages_of,
    pictures_of,
    seen,
    write_page,
)
from jfsf.apps.cli._print import WARNING
from jfsf.apps.cli._runs import DRAWING
from jfsf.apps.cli._stored import kept_match, write_found

RECORD = "pairs.json"  # the options of pairs that have some of their own
_OF_THE_PAGE = "gt_x", "gt_y"


def options_of_pairs(list_file: Path, listed: Sequence, usual, *, pages: bool) -> dict:
    """The options of each pair, all fields known, by its name.

    Args:
        list_file: opens the message of an error.
        listed: pairs of `read_pairs`.
        usual: `PairOptions` of a pair whose line says nothing.
        pages: whether pages are written, for which ground truth is.

    Raises:
        ValueError: options of a pair do not go together, or landmarks of one side are
            for no pair.
    """
    found = {}
    for pair in listed:
        own = pair.options
        options = usual
        # Landmarks of one kind take the place of those of the other.
        if own.landmarks is not None:
            options = options._replace(landmarks_x=None, landmarks_y=None)
        if own.landmarks_x is not None or own.landmarks_y is not None:
            options = options._replace(landmarks=None)
        said = {k: v for k, v in own._asdict().items() if v is not None}
        options = options._replace(**said)
        # Those of a template are for the pairs whose line names the other's.
        if own.landmarks_x is None and own.landmarks_y is None:
            if (options.landmarks_x is None) != (options.landmarks_y is None):
                options = options._replace(landmarks_x=None, landmarks_y=None)
        # Absolute, because each worker has its own working folder.
        files = {k: v for k, v in options._asdict().items() if isinstance(v, Path)}
        options = options._replace(**{k: file.absolute() for k, file in files.items()})
        try:
            check_pair(options, report=pages)
        except ValueError as error:
            raise ValueError(f"{list_file}: {pair.x}, {pair.y}: {error}") from None
        found[pair.name] = options
    used = any(one.landmarks_x is not None for one in found.values())
    for side, other in ("xy", "yx"):
        given = getattr(usual, f"landmarks_{side}")
        if given is not None and not used:
            raise ValueError(
                f"{list_file}: --landmarks-{side} is {given}, and no line names "
                f"landmarks_{other}; add that column"
            )
    return found


def prepared_kinds(jobs: Sequence, usual: tuple[bool, bool]) -> dict[Path, tuple]:
    """How meshes are needed that are not needed in the usual way alone.

    Args:
        jobs: with the options of a pair.
        usual: whether the largest piece is taken, and whether meshes are repaired.
    """
    kinds: dict[Path, dict] = {}
    for job in jobs:
        kind = job.options.largest_component, job.options.repair
        for path in job.inputs:
            kinds.setdefault(path, {})[kind] = None
    return {path: tuple(own) for path, own in kinds.items() if tuple(own) != (usual,)}


def forget_outdated(out: Path, options: dict, usual) -> None:
    """Remove results of pairs that were made with other options, and note the new ones.

    Args:
        out: the folder of the results.
        options: of `options_of_pairs`.
        usual: options that are those of the whole folder.
    """
    from jfsf.storage._atomic import write_text

    path = out / RECORD
    before = _read(path)
    now = before | {name: _own(one, usual) for name, one in options.items()}
    for name in options:
        old, new = before.get(name, {}), now[name]
        result = out / f"{name}.npz"
        if old != new:
            # Before the new ones are noted: an interrupt must not leave a result that
            # seems to be made with them.
            pages_of(result)[0].unlink(missing_ok=True)
        if _of_the_map(old) != _of_the_map(new):
            result.unlink(missing_ok=True)
    now = {name: own for name, own in now.items() if own}
    if now or path.exists():
        write_text(path, json.dumps(now, indent=1) + "\n")


def _own(options, usual) -> dict[str, Any]:
    """What differs from the usual options, as JSON has it."""
    return {
        name: str(value) if isinstance(value, Path) else value
        for name, value in options._asdict().items()
        if value != getattr(usual, name)
    }


def _of_the_map(own: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in own.items() if name not in _OF_THE_PAGE}


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def prepare(
    path: Path,
    usual: tuple[bool, bool],
    others: dict[Path, tuple[tuple[bool, bool], ...]],
    cache: bool = True,
) -> None:
    """Check a mesh and put its spectrum into the cache, for all of its pairs.

    Args:
        path: the file of the mesh.
        usual: of all meshes, whether the largest piece is taken, and whether they are
            repaired.
        others: the same for meshes that are needed in other ways.
        cache: whether spectra are kept at all.

    Raises:
        MeshError: it cannot be matched in any of the ways in which it is needed.
    """
    from jfsf.matching import basis
    from jfsf.mesh import MeshError

    wrong = []
    kinds = others.get(path, (usual,))
    for largest, mend in kinds:
        try:
            mesh = matchable(path, largest, mend).mesh
            if cache:
                basis(mesh, name=str(path))
        except MeshError as error:
            wrong.append(error)
    # If it is needed in another way too, the pairs fail for themselves.
    if len(wrong) == len(kinds):
        raise wrong[0]


def work(
    job,
    wanted: dict[str, Any] | None = None,
    base: int | None = None,
    cache: bool = True,
    same_unit: bool = True,
) -> None:
    """Match a pair and write it, its page and its pictures, as `jfsf match` does."""
    from jfsf.apps.mapfiles import read_match

    given, pictures = job.options, pictures_of(job.out, **(wanted or {}))
    shapes = both_matchable(job.inputs, given)
    if is_matched(job):
        # Only its page or its pictures are missing.
        result, seconds = kept_match(read_match(job.out), *shapes), {}
    else:
        known = known_pairs(given, shapes)
        units = check_units(job.inputs, shapes, given, same_unit)
        result, seconds = find(shapes, given, known, same_unit=same_unit, cache=cache)
        notes = notes_of(job.inputs, shapes, given, known, brief=True)
        notes += [WARNING + units] if units else []
        write_found(job.out, result, *shapes, notes)
    draw(pictures, shapes, job.inputs, seen(result))
    write_page(
        pictures,
        job.inputs,
        [(shape.mesh, shape.index) for shape in shapes],
        result,
        orientation=given.orientation,
        truth=kept_truth(given, shapes, base),
        seconds=seconds,
        cache=cache,
    )


def is_matched(job) -> bool:
    """Whether the match is there, and can be read."""
    from jfsf.apps.mapfiles import MapFileError, read_match
    from jfsf.batch._jobs import is_done

    try:
        return is_done(job) and bool(np.size(read_match(job.out).T_xy))
    except MapFileError:  # damaged, say by a crash of the machine: made again
        return False


def is_complete(job, wanted: dict[str, Any]) -> bool:
    """Whether the match is there, and all that is drawn of it, as it is asked for."""
    if not is_matched(job):
        return False
    given, drawing = job.options, job.out.parent / DRAWING
    pictures = pictures_of(job.out, **wanted)
    used = [job.out, *([drawing] if drawing.exists() else [])]
    if pictures.page is not None:
        used += [path for path in (given.gt_x, given.gt_y) if path is not None]
    made = max(path.stat().st_mtime_ns for path in used)
    files = pictures.png, pictures.page, pictures.thumbnail, *pictures.exports
    return all(f.exists() and f.stat().st_mtime_ns >= made for f in files if f)
