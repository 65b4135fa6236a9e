"""Check the arrays of a mesh (numpy)."""

from os import PathLike, fspath
from typing import Self

import numpy as np

from jfsf.types import ArrayLike, Mesh

# What to do about coordinates that are not finite.
LEAVE_OUT = "leave them out with jfsf.mesh.repair"


class InputError(ValueError):
    """An input that cannot be used. The message says why and what to do, on one line.

    what: what is wrong with it.
    advice: what to do; "" if that is plain.
    name: of the input: its file or argument; "" if it is not known.
    """

    def __init__(self, what: str, advice: str = "", name: str = "") -> None:
        # All of them are `args`, from which an error is made again in other processes.
        super().__init__(what, advice, name)
        self.what, self.advice, self.name = what, advice, name

    def __str__(self) -> str:
        before = f"{self.name}: " if self.name else ""
        after = f"; {self.advice}" if self.advice else ""
        return f"{before}{self.what}{after}"

    def named(self, name: str) -> Self:
        """The same error of an input of this name."""
        return type(self)(self.what, self.advice, name)


class MeshError(InputError):
    """A mesh that cannot be read or matched. The message says why and what to do.

    what: what is wrong with it.
    advice: what to do; "" if that is plain.
    name: the mesh's file or argument; "" if it is not known.
    """


def mesh_arrays(mesh: Mesh, name: str = "mesh") -> tuple[np.ndarray, np.ndarray]:
    """The vertices and the faces of a mesh by numpy.

    Args:
        mesh: a Mesh, or another record with vertices and faces.
        name: opens the message: the file or the argument.

    Raises:
        MeshError: it is no mesh, such as the path of one or a pair of arrays.
    """
    try:
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except AttributeError:
        pass
    found, advice = f"is a {type(mesh).__name__}", "pass jfsf.Mesh(vertices, faces)"
    if isinstance(mesh, str | PathLike):
        found, advice = f"{found}, {fspath(mesh)!r}", "read it with jfsf.read"
    raise MeshError(f"{found}, not a mesh", advice, name)


def checked_mesh(mesh: Mesh, name: str) -> Mesh:
    """The mesh in numpy arrays, of any type that `check_values` takes.

    Raises:
        MeshError: as `check_values`.
    """
    vertices, faces = mesh_arrays(mesh, name)
    check_values(vertices, faces, name)
    # Differences of whole numbers would wrap round.
    whole = vertices.dtype.kind in "iu"
    return Mesh(vertices.astype(np.float64) if whole else vertices, faces)


def check_values(
    vertices: ArrayLike, faces: ArrayLike, name: str, *, finite: bool = True
) -> None:
    """Raise MeshError unless vertices are finite, n > 0, and faces are among them.

    Args:
        vertices: (n, 3) real.
        faces: (m, 3) integer, 0-based; m may be 0.
        name: opens the message.
        finite: False lets coordinates pass that are not finite.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise MeshError(
            f"vertices are {vertices.dtype} {vertices.shape}", "pass (n, 3) real", name
        )
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise MeshError(
            f"faces are {faces.dtype} {faces.shape}",
            "pass (m, 3) integer, (0, 3) for a point cloud",
            name,
        )
    n = len(vertices)
    if n == 0:
        raise MeshError("has 0 vertices", "choose a file that holds a shape", name)
    bad = ~np.isfinite(vertices).all(axis=1)
    if finite and bad.any():
        first = np.argmax(bad)
        raise MeshError(
            f"vertex {first} is {vertices[first].tolist()}, {bad.sum()} of {n} are "
            "not finite",
            LEAVE_OUT,
            name,
        )
    out = (faces < 0) | (faces >= n)
    if out.any():
        raise MeshError(
            f"a face names vertex {faces[out][0]}, but the {n} vertices are 0 to "
            f"{n - 1} (counted from 0)",
            "export the mesh again",
            name,
        )


def check_plain_numbers(text: str) -> None:
    """Raise MeshError if a word holds an underscore: Python takes 1_0 for 10."""
    if "_" in text:
        word = next(word for word in text.split() if "_" in word)
        raise MeshError(f"it has {word[:40]!r} for a number", "export it again")
