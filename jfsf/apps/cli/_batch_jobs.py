"""The jobs of `jfsf batch`: a spectrum a mesh, then a match a pair. In the workers."""

from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from jfsf.apps.cli._batch_options import landmark_files
from jfsf.apps.cli._exports import Looks, draw, export, seen
from jfsf.apps.cli._files import kept_match, matchable, write_found
from jfsf.apps.cli._landmarks import known_pairs
from jfsf.apps.cli._notes import WARNING, check_units, notes_of
from jfsf.apps.cli._pages import kept_truth, pages_of, pair_page
from jfsf.apps.cli._runs import DRAWING


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
    looks: Looks = Looks(),
    report: bool = False,
    png: bool = False,
    suffixes: tuple[str, ...] = (),
    base: int | None = None,
    cache: bool = True,
    same_unit: bool = True,
) -> None:
    """Match a pair and write it, its page and its pictures, as `jfsf match` does."""
    from jfsf.apps.mapfiles import read_match
    from jfsf.matching import match

    given = job.options
    x, y = (
        matchable(path, given.largest_component, given.repair) for path in job.inputs
    )
    shapes = x, y
    if is_matched(job):
        # Only its page or its pictures are missing.
        result, seconds = kept_match(read_match(job.out), x, y), {}
    else:
        known = known_pairs(landmark_files(given), shapes)
        one_unit = given.partial and same_unit
        units = check_units(job.inputs, shapes) if one_unit else ""
        started = perf_counter()
        options: dict[str, Any] = {
            "orientation": given.orientation,
            "partial": given.partial,
            "cache": cache,
        }
        if given.partial and not same_unit:
            options["same_unit"] = False
        if known is not None:
            options["landmarks"] = known.rows
        result = match(x.mesh, y.mesh, **options)
        seconds = {"matching": perf_counter() - started}
        said = () if known is None else known.said
        notes = notes_of(
            job.inputs, shapes, partial=given.partial, said=said, brief=True
        )
        notes += [f"{WARNING}{units}"] if units else []
        write_found(job.out, result, x, y, notes)
    if png:
        draw(job.out.with_suffix(".png"), x, y, seen(result), looks)
    files = [job.out.with_suffix(suffix) for suffix in suffixes]
    export(files, x, y, job.inputs[1], seen(result), looks)
    if report:
        inputs = [
            (path, own.mesh, own.index)
            for path, own in zip(job.inputs, shapes, strict=True)
        ]
        pair_page(
            job.out,
            inputs,
            result,
            orientation=given.orientation,
            truth=kept_truth(given.gt_x, given.gt_y, shapes, base),
            up=looks.up,
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


def is_complete(job, report: bool, png: bool, suffixes: tuple[str, ...]) -> bool:
    """Whether the match is there, and all that is drawn of it, as it is asked for."""
    if not is_matched(job):
        return False
    given, drawing = job.options, job.out.parent / DRAWING
    truth = [path for path in (given.gt_x, given.gt_y) if path is not None and report]
    used = [job.out, *truth, *([drawing] if drawing.exists() else [])]
    made = max(path.stat().st_mtime_ns for path in used)
    files = list(pages_of(job.out)) if report else []
    files += [job.out.with_suffix(".png")] if png else []
    files += [job.out.with_suffix(suffix) for suffix in suffixes]
    return all(f.exists() and f.stat().st_mtime_ns >= made for f in files)
