"""name -> Sample: the shapes of the package. PROVENANCE.md names their source."""

from importlib.resources import files
from io import BytesIO
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jfsf.types import Mesh


class Sample(NamedTuple):
    """A shape of the package, and its correspondence with the common template.

    The ground truth of a pair (A, B) is
    A.template_to_vertex[i] <-> B.template_to_vertex[i] for every template point i.
    Several template points may share a vertex; about 3 vertices in 10 have none.

    mesh: the shape: closed, manifold, one component, wound outward; in metres, y up,
        facing +z.
    template_to_vertex: the vertex of `mesh`, from 0, for each template point.
    """

    mesh: Mesh
    template_to_vertex: Int[np.ndarray, " 13380"]


def names() -> tuple[str, ...]:
    """The names of the shapes, BODY_POSE, in alphabetical order."""
    entries = (entry.name for entry in files("jfsf.data").iterdir())
    return tuple(sorted(e.removesuffix(".npz") for e in entries if e.endswith(".npz")))


def load(name: str) -> Sample:
    """Read one shape of about 5000 vertices; each call returns new arrays.

    Args:
        name: one of `names()`, such as "man_walk".

    Returns:
        The shape: vertices float64 in metres, faces and template_to_vertex int32.

    Raises:
        ValueError: there is no such shape; the message lists all names.
    """
    if name not in (known := names()):
        raise ValueError(f"load: no shape {name!r}; there are {', '.join(known)}")
    with np.load(BytesIO((files("jfsf.data") / f"{name}.npz").read_bytes())) as data:
        vertices = data["vq"].astype(np.float64) * float(data["scale"]) + data["lo"]
        faces, template = (
            data[k].astype(np.int32) for k in ("f", "template_to_vertex")
        )
    return Sample(Mesh(vertices, faces), template)
