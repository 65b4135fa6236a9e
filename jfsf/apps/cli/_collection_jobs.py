"""The jobs of `jfsf collection`: each makes one file from some others.

They run in worker processes, which may be other machines that see the same files.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jfsf.apps.cli._files import matchable
from jfsf.types import Maps, Mesh

RECENT = 64  # sketches that are held: triangles of pairs share shapes


def file_of(out: Path, part: str, name: str) -> Path:
    """The file of a shape in a part of the results, which is a folder of `out`."""
    return out / part / f"{name}.npz"


def picture_of_shape(out: Path, name: str) -> Path:
    """The file of the picture of a shape that was joined."""
    return out / "pictures" / f"{name}.png"


class Kept(NamedTuple):
    """A mesh of a collection, as it is matched.

    mesh: what is left of the file.
    at: the vertex in the file of each vertex.
    sketch: of `sketch`.
    said: of the `Shape`.
    """

    mesh: Mesh
    at: np.ndarray
    sketch: Any
    said: tuple[str, ...] = ()


class KeptShapes(Mapping[str, Kept]):
    """What is kept of shapes, by name: read anew whenever it is asked for.

    So the memory of a run does not grow by the meshes and sketches of its shapes.
    """

    def __init__(self, files: Mapping[str, Path]):
        self._files = dict(files)

    def __getitem__(self, name: str) -> Kept:
        return kept(self._files[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


class Sketches(Sequence):
    """The sketches of shapes, in their order; few are held."""

    def __init__(self, shapes: Mapping[str, Kept]):
        self._names = list(shapes)
        self._read = lru_cache(RECENT)(lambda name: shapes[name].sketch)

    def __getitem__(self, number):
        return self._read(self._names[number])

    def __len__(self) -> int:
        return len(self._names)


def nothing(path: Path) -> None:
    """No preparation: the spectra are those of the first jobs."""


def keep(job, largest: bool, mend: bool) -> None:
    """Write what is kept of a mesh, and put its spectrum into the cache.

    The file keeps its date if only the options are others, and the mesh is the same:
    what was made of it counts.
    """
    from jfsf.apps.collections._collection import check_surface
    from jfsf.apps.collections._cycles import sketch
    from jfsf.batch._jobs import is_done
    from jfsf.matching import basis
    from jfsf.storage._atomic import write_atomically

    (path,) = job.inputs
    shape = matchable(path, largest, mend)
    check_surface(shape.mesh, str(path))
    n = len(shape.mesh.vertices)
    index = np.arange(n) if shape.index is None else np.asarray(shape.index)
    mesh = {
        "vertices": np.asarray(shape.mesh.vertices),
        "faces": np.asarray(shape.mesh.faces),
        "index": index.astype(np.int32),
    }
    before = None
    if is_done(job):
        with np.load(job.out) as file:
            if all(np.array_equal(file[name], own) for name, own in mesh.items()):
                before = job.out.stat()
    arrays = {
        **mesh,
        "said": np.array(shape.said, str),
        "options": np.array([largest, mend]),
        **sketch(basis(shape.mesh, name=str(path)))._asdict(),
    }
    write_atomically(job.out, lambda file: np.savez(file, **arrays))
    if before is not None:
        os.utime(job.out, ns=(before.st_atime_ns, before.st_mtime_ns))


def is_kept(job, largest: bool, mend: bool) -> bool:
    """Whether `keep` has nothing to do."""
    from jfsf.batch._jobs import is_done

    if not is_done(job):
        return False
    with np.load(job.out) as file:
        return np.array_equal(file["options"], [largest, mend])


def kept(path: Path) -> Kept:
    """What `keep` wrote."""
    from jfsf.apps.collections._cycles import Sketch

    with np.load(path) as file:
        mesh = Mesh(file["vertices"], file["faces"])
        numbers = Sketch(*(file[name] for name in Sketch._fields))
        return Kept(mesh, file["index"], numbers, tuple(file["said"].tolist()))


def match_pair(job, orientation: str, turned: bool) -> None:
    """Match two shapes, the first one mirrored if `turned`."""
    from jfsf.matching import match
    from jfsf.mesh._edit import mirror_image

    x, y = map(kept, job.inputs)
    if turned:
        x = x._replace(mesh=mirror_image(x.mesh))
    write_maps(job.out, match(x.mesh, y.mesh, orientation=orientation), x, y)  # type: ignore


def write_maps(path: Path, match, x: Kept, y: Kept) -> None:
    """Write a match as `jfsf match` does; the same file in every run."""
    from jfsf.apps.mapfiles import write_match

    # How long it took would make equal results unequal files.
    match = match._replace(info=None)
    write_match(path, match, index_x=x.at, index_y=y.at)


def read_maps(path: Path):
    """The maps of a file of `write_maps`, and their confidence."""
    from jfsf.apps.collections._grow import matched
    from jfsf.apps.mapfiles import read_match

    return matched(read_match(path))


def is_put(job) -> bool:
    """Whether `put_template` has nothing to do, without a report."""
    from jfsf.batch._jobs import is_done

    return is_done(job) and (_of_itself(job) or _maps(job).exists())


def has_page(job) -> bool:
    """Whether `put_template` has nothing to do, a report included."""
    from jfsf.apps.cli._pair import pages_of

    pages = [] if _of_itself(job) else pages_of(_maps(job))
    drawn = *pages, picture_of_shape(_out(job), job.out.stem)
    return is_put(job) and all(path.exists() for path in drawn)


def _of_itself(job) -> bool:
    """Whether its shape is the template."""
    return job.inputs[0] == job.inputs[1]


def _maps(job) -> Path:
    """The file of the maps between the template and the shape of a job."""
    return _out(job) / "maps" / job.out.name


def _out(job) -> Path:
    return job.out.parent.parent


def put_template(job, report: bool) -> None:
    """Match the template with a shape by way of other shapes, and put it there.

    job: the kept template, the kept shape and the way are its inputs: T_xy, and whether
        the shape is to be mirrored.
    """
    from jfsf.apps.cli._pair import pictures_of, write_page
    from jfsf.apps.collections._member import itself, member

    template, shape = map(kept, job.inputs[:2])
    if _of_itself(job):
        found = itself(template.mesh)
    else:
        with np.load(job.inputs[2]) as way:
            T, turned = way["T_xy"], way["turned"]
        shape = shape._replace(mesh=_turned(shape.mesh, bool(turned)))
        found = member(template.mesh, shape.mesh, T)
        maps = _maps(job)
        maps.parent.mkdir(exist_ok=True)
        write_maps(maps, found.match, template, shape)
        if report:
            pictures = pictures_of(maps, report=True)
            meshes = (template.mesh, template.at), (shape.mesh, shape.at)
            # Without times: what is made again is then the same, to the byte.
            write_page(pictures, job.inputs[:2], meshes, found.match, timed=False)  # type: ignore
    if report:
        _write_picture(job, template.mesh, shape.mesh, found.maps)
    _write_registration(job.out, found.registration, found.confidence)


def put_agreed(job) -> None:
    """Put the template on a shape by all trusted ways, and write it as a mesh too.

    job: the kept template, the kept shape and its `put_template` are its inputs; extras
        are the maps from other shapes, then of each the kept shape and `put_template`.
    """
    from jfsf.apps.collections._member import OtherShape, agreed_registration
    from jfsf.apps.export import export_mesh

    template, shape = (kept(path).mesh for path in job.inputs[:2])
    own, confidence = _read_registration(job.inputs[2])
    if not _of_itself(job):
        with np.load(job.extras[0]) as file:
            turned = file["turned"]
            maps = [file[f"T_{i}"] for i in range(len(turned) - 1)]
        meshes = [kept(path).mesh for path in job.extras[1::2]]
        placed = [_read_registration(path)[0].vertices for path in job.extras[2::2]]
        others = [
            OtherShape(_turned(mesh, turn), on, T)
            for mesh, turn, on, T in zip(meshes, turned[1:], placed, maps, strict=True)
        ]
        shape = _turned(shape, turned[0])
        own = agreed_registration(template, shape, own, others)
    values = {"quality": own.distance, "bridged": own.bridged}
    on_shape = Mesh(own.vertices, template.faces)
    export_mesh(job.out.with_suffix(".ply"), on_shape, values=values)
    _write_registration(job.out, own, confidence)


def _write_picture(job, template: Mesh, mesh: Mesh, maps: Maps) -> None:
    """Write a picture of the shape of a job in the template's colours."""
    from jfsf.apps.report._collection import shape_picture
    from jfsf.apps.report._html import thumbnail

    path = picture_of_shape(_out(job), job.out.stem)
    path.parent.mkdir(exist_ok=True)
    thumbnail(shape_picture(mesh, template, maps.T_xy, maps.T_yx), path)


def _turned(mesh: Mesh, turn: bool) -> Mesh:
    from jfsf.mesh._edit import mirror_image

    return mirror_image(mesh) if turn else mesh


def _write_registration(path: Path, registration, confidence: float) -> None:
    from jfsf.storage._atomic import write_atomically

    arrays: dict[str, Any] = {**registration._asdict(), "confidence": confidence}
    write_atomically(path, lambda file: np.savez(file, **arrays))


def _read_registration(path: Path):
    """What `_write_registration` wrote: the registration, and the confidence."""
    from jfsf.apps.registration import Registration

    with np.load(path) as file:
        found = Registration(*(file[name] for name in Registration._fields))
        return found, float(file["confidence"])
