"""The options of each pair of `jfsf batch`, and results that were made with others."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jfsf.apps.cli._landmarks import LandmarkFiles, check_landmark_options
from jfsf.apps.cli._pages import pages_of

RECORD = "pairs.json"  # the options of pairs that have some of their own
_OF_THE_PAGE = "gt_x", "gt_y"


def options_of_pairs(list_file: Path, listed: Sequence, usual, *, pages: bool) -> dict:
    """The options of each pair, all fields known, by its name.

    Args:
        list_file: opens the message of an error.
        listed: pairs of `jfsf.batch.read_pairs`.
        usual: `PairOptions` of a pair whose line says nothing.
        pages: whether pages are written, for which ground truth is.

    Raises:
        ValueError: options of a pair do not go together, or landmarks of one side are
            for no pair.
    """
    found = {}
    for pair in listed:
        own = pair.options
        base = usual
        # Landmarks of one kind take the place of those of the other.
        if own.landmarks is not None:
            base = base._replace(landmarks_x=None, landmarks_y=None)
        if own.landmarks_x is not None or own.landmarks_y is not None:
            base = base._replace(landmarks=None)
        said = {k: v for k, v in own._asdict().items() if v is not None}
        options = base._replace(**said)
        # Those of a template are for the pairs whose line names the other's.
        if own.landmarks_x is None and own.landmarks_y is None:
            if (options.landmarks_x is None) != (options.landmarks_y is None):
                options = options._replace(landmarks_x=None, landmarks_y=None)
        absolute = {
            name: value.absolute()
            for name, value in options._asdict().items()
            if isinstance(value, Path)
        }
        options = options._replace(**absolute)
        try:
            check_landmark_options(landmark_files(options))
            if (options.gt_x is None) != (options.gt_y is None):
                raise ValueError("ground truth takes both gt_x and gt_y")
            if options.gt_x is not None and not pages:
                raise ValueError("ground truth is for the pages; add --report")
        except ValueError as error:
            raise ValueError(f"{list_file}: {pair.x}, {pair.y}: {error}") from None
        found[pair.name] = options
    for side, other in ("xy", "yx"):
        given = getattr(usual, f"landmarks_{side}")
        sides = [(one.landmarks_x, one.landmarks_y) for one in found.values()]
        if given is not None and not any(all(pair) for pair in sides):
            raise ValueError(
                f"{list_file}: --landmarks-{side} is {given}, and no line names "
                f"landmarks_{other}; add that column"
            )
    return found


def landmark_files(options) -> LandmarkFiles:
    """The files of landmarks of a pair."""
    return LandmarkFiles(options.landmarks, options.landmarks_x, options.landmarks_y)


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
