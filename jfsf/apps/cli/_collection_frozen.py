"""A finished collection, which `jfsf collection --onto` reads and leaves as it is."""

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jfsf.apps.cli._collection_carried import Carried, carried_of
from jfsf.apps.cli._collection_jobs import Kept, file_of, kept
from jfsf.apps.cli._look import doubts
from jfsf.apps.cli._runs import SETTINGS

if TYPE_CHECKING:
    from jfsf.apps.landmarks import Landmarks


class Frozen(NamedTuple):
    """A finished collection, which is only read.

    folder: of its results.
    template: the name of its template.
    trust: of each shape that joined as it is, by its name: a mirror image that was
        mirrored back is no partner of others.
    known: the names of all its shapes, those left out too.
    orientation: as `jfsf.collection`.
    """

    folder: Path
    template: str
    trust: Mapping[str, float]
    known: frozenset[str]
    orientation: str

    @property
    def kept_template(self) -> Path:
        """The file of what is kept of the template."""
        return file_of(self.folder, "shapes", self.template)


def frozen_of(model: Path) -> Frozen:
    """Read what a finished collection says of its shapes.

    Raises:
        ValueError: it is none; the message says what it lacks.
    """
    wrong = lambda why: ValueError(
        f"{model}: is no finished collection ({why}); name the --out of one that ended"
    )
    try:
        settings = json.loads((model / SETTINGS).read_text(encoding="utf-8"))
        with (model / "summary.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        joined = [row for row in rows if not row["reason"]]
        trust = {row["name"]: float(row["trust"]) for row in joined}
        plain = {
            row["name"]: trust[row["name"]] for row in joined if row["mirrored"] == "0"
        }
        orientation = settings["orientation"]
    except OSError as error:
        raise wrong(f"{Path(error.filename).name}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise wrong("settings.json or summary.csv is damaged") from None
    itself = [name for name in trust if not file_of(model, "maps", name).exists()]
    if len(itself) != 1:
        raise wrong(f"{len(itself)} shapes without maps from the template, not one")
    needed = [model / "model.npz"]
    needed += [
        file_of(model, part, n) for part in ("shapes", "registered") for n in trust
    ]
    if gone := [path for path in needed if not path.exists()]:
        raise wrong(f"{gone[0].relative_to(model)} is missing")
    names = frozenset(row["name"] for row in rows)
    return Frozen(model.absolute(), itself[0], plain, names, orientation)


def check_new(
    frozen: Frozen,
    paths: Mapping[str, Path],
    out: Path,
    template: Path | None,
    orientation: str,
) -> None:
    """ValueError if shapes or options do not fit the finished collection.

    Args:
        frozen: the collection.
        paths: the new files, by name.
        out: folder of the results.
        template: the file that is named as the template's.
        orientation: as `jfsf.collection`.
    """
    from jfsf.mesh import read

    for name in sorted(frozen.known & set(paths)):
        raise ValueError(
            f"{paths[name]}: {frozen.folder} has a shape of this name; rename yours"
        )
    if out.is_dir() and out.samefile(frozen.folder):
        raise ValueError(
            f"{out}: is the --onto, which stays as it is; name another one"
        )
    if orientation != frozen.orientation:
        raise ValueError(
            f"{frozen.folder}: was made with --orientation {frozen.orientation}; give "
            "the same"
        )
    if template is not None:
        own, file = (
            kept(frozen.kept_template),
            read(template),
        )
        there = np.max(own.at, initial=0) < len(file.vertices)
        if not there or not np.allclose(file.vertices[own.at], own.mesh.vertices):
            raise ValueError(
                f"{template}: is not the file of {frozen.template}, the template of "
                f"{frozen.folder}; name that, or leave --template out"
            )


def marks_of(
    frozen: Frozen,
) -> "tuple[Path, Landmarks, dict[str, np.ndarray]] | None":
    """The file of the template's landmarks, these, and `lists_in`; None without any."""
    from jfsf.apps.landmarks import read_landmarks
    from jfsf.apps.morphometrics._tables import lists_in

    path = frozen.folder / "landmarks" / f"{frozen.template}.mrk.json"
    if not path.exists():
        return None
    found = read_landmarks(path)
    return path, found, lists_in(frozen.folder, len(found.names))


def columns_of(frozen: Frozen) -> tuple[list[Carried], list[str]]:
    """Labels and values of the template, and what to say of those not to be used."""
    own, said_of = kept(frozen.kept_template).mesh, []
    found = []
    for what in ("labels", "values"):
        for path in sorted((frozen.folder / what).glob(f"{frozen.template}.*")):
            try:
                found += carried_of(own, **{what: path})
            except ValueError as error:
                said_of.append(
                    f"{path}: not carried ({error}); name it, and the template's file"
                )
    return found, said_of


def odd_beside(frozen: Frozen, paths, shapes: Mapping[str, Kept]) -> list[str]:
    """`doubts` of each new shape, beside the template and the most alike shape."""
    base = kept(frozen.kept_template)
    near, lines = nearest_of(frozen, shapes), []
    for name, own in shapes.items():
        most = kept(file_of(frozen.folder, "shapes", [*near[name], frozen.template][0]))
        where = str(paths[name])
        beside = doubts([where, "", ""], [own, most, base])
        lines += [line for line in beside if line.startswith(f"{where}: ")]
    return lines


def nearest_of(frozen: Frozen, shapes: Mapping[str, Kept]) -> dict[str, list[str]]:
    """The most alike finished shapes of each, the template aside, the first the most.

    Of those that are surely joined, if there are any.
    """
    from jfsf.apps.collections._cycles import unlikeness
    from jfsf.apps.collections._grow import MOST_OF_ONE, SURE

    others = [name for name in frozen.trust if name != frozen.template]
    sure = [name for name in others if frozen.trust[name] >= SURE] or others
    if not sure:
        return {name: [] for name in shapes}
    signatures = []
    for name in sorted(sure):
        with np.load(file_of(frozen.folder, "shapes", name)) as file:
            signatures.append(file["signature"])
    found = {}
    for name, own in shapes.items():
        unlike = unlikeness([own.sketch.signature, *signatures])[0, 1:]
        order = np.argsort(unlike, kind="stable")[: MOST_OF_ONE - 1]
        found[name] = [sorted(sure)[i] for i in order.tolist()]
    return found
