"""A collection as one page: its shapes, the graph of its pairs, and its triangles."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from jfsf.apps.collections._cycles import AGREE_BELOW
from jfsf.apps.collections._grow import TRUSTED, Graph
from jfsf.apps.plot import draw_shape
from jfsf.apps.plot._colours import body_colours
from jfsf.apps.plot._frames import frame, frames_of_pair
from jfsf.apps.report._html import Row, data_url, listed, page
from jfsf.apps.report._scene import shown
from jfsf.apps.report._words import level
from jfsf.storage._atomic import write_text
from jfsf.types import ArrayLike, Mesh

MOST_DRAWN = 300  # shapes of a graph; more are a blot
MOST_LISTED = 40  # triangles and dropped pairs
_FEW = 6000  # vertices of a picture
_SMALL = 60  # dots per inch
_STEPS = 200  # of the majorisation


def write_collection_page(
    path: str | os.PathLike[str],
    rows: Sequence[Row],
    graph: Graph,
    names: Sequence[str],
    *,
    links: Mapping[str, str] | None = None,
) -> None:
    """Write the page of a collection.

    Shapes that were left out come first, then the least confident. Below is the graph
    of the pairs that were matched, those marked whose maps are not trusted, and how far
    the maps round triangles disagree.

    Args:
        path: the page, written completely or not at all.
        rows: of all shapes, in any order; those that were left out have failed.
        graph: of the shapes that could be matched.
        names: of these, in the order of their numbers.
        links: what else there is to open: text -> address relative to the page.
    """
    left = sum(row.failed for row in rows)
    counts = f"{len(rows)} shapes, {len(rows) - left} joined, template "
    counts += f"{names[graph.paths.template]}, {len(graph.matched)} pairs matched"
    record = {
        "title": "Shapes by confidence",
        "counts": counts,
        "rows": listed(rows, failed="left out"),
        "links": dict(links or {}),
        "graph": _graph(graph, names),
        **_cycles(graph, names),
        "dropped": _dropped(graph, names),
    }
    write_text(path, page("collection", record))


def shape_picture(
    mesh: Mesh,
    template: Mesh | None = None,
    T_xy: Int[ArrayLike, " n_x"] | None = None,
    T_yx: Int[ArrayLike, " n_y"] | None = None,
) -> str:
    """A shape in the template's colours, as the address of an image (`data:`).

    Args:
        mesh: the shape, Y.
        template: X, whose colours are laid on it as it stands; without it the shape is
            grey.
        T_xy, T_yx: maps between both, needed with the template.

    Raises:
        ImportError: matplotlib is missing; the message says how to install it.
        ValueError: a template without maps.
    """
    colours = None
    if template is None:
        axes = frame("y")
    elif T_xy is None or T_yx is None:
        raise ValueError("shape_picture: has a template without maps; give both")
    else:
        frame_x, axes = frames_of_pair(template, mesh, T_xy)
        stood = np.asarray(template.vertices, float) @ frame_x
        colours = body_colours(stood)[np.asarray(T_yx)]
    few = shown(mesh, axes, _FEW)
    if colours is not None:
        colours = colours[few.index]
    return data_url(draw_shape(few.body, colours), _SMALL)


def _graph(graph: Graph, names) -> dict[str, Any] | None:
    """Places of the shapes and kinds of the pairs; None if they are too many."""
    s = len(names)
    if s > MOST_DRAWN:
        return None
    edges = sorted(graph.matched)
    before = graph.paths.before.tolist()
    on_a_way = {
        (min(i, b), max(i, b))
        for i, b in enumerate(before)
        if b >= 0 and graph.joined[i]
    }
    drawn = []
    for a, b in edges:
        right = graph.right[a, b]
        kind = "way" if (a, b) in on_a_way else "trusted"
        kind = kind if right >= TRUSTED else "dropped"
        drawn.append([a, b, kind, f"{names[a]}, {names[b]}: {_chances(graph, (a, b))}"])
    return {
        "nodes": [
            {
                "name": names[i],
                "at": np.round(point, 4).tolist(),
                "level": _level(graph, i),
                "text": f"{names[i]}: trust {graph.paths.trust[i]:.2f}",
            }
            for i, point in enumerate(places(edges, s))
        ],
        "edges": drawn,
    }


def _level(graph: Graph, shape: int) -> str:
    if shape == graph.paths.template:
        return "template"
    if not graph.joined[shape]:
        return "failed"
    return level(float(graph.paths.trust[shape]))


def _chances(graph: Graph, edge: tuple[int, int]) -> str:
    alone = graph.matched[edge].confidence
    text = "unknown" if np.isnan(alone) else f"{alone:.2f}"
    return f"{text} alone, {graph.right[edge]:.2f} with the triangles"


def _cycles(graph: Graph, names) -> dict[str, Any]:
    """The triangles whose maps disagree most, and a sentence on all."""
    worst = sorted(graph.found, key=lambda one: (-one.apart, one.corners))
    apart = [one.apart for one in worst]
    said = "No three shapes were all matched with each other."
    if apart:
        alike = sum(a < AGREE_BELOW for a in apart)
        said = (
            f"{len(apart)} triangles, the maps round {alike} of them agree (below "
            f"{AGREE_BELOW:g}); median {np.median(apart):.3f}. Maps by way of the "
            "template agree round all cycles, up to rounding to vertices."
        )
    return {
        "cycles": said,
        "triangles": [
            (
                ", ".join(names[i] for i in one.corners),
                f"{one.apart:.3f}",
                "agree" if one.apart < AGREE_BELOW else "disagree",
            )
            for one in worst[:MOST_LISTED]
        ],
    }


def _dropped(graph: Graph, names) -> list[tuple[str, str, str]]:
    """The pairs whose maps are not trusted, the least probable first."""
    pairs = [(p, e) for e, p in graph.right.items() if p < TRUSTED]
    return [
        (f"{names[a]}, {names[b]}", f"{p:.2f}", _chances(graph, (a, b)))
        for p, (a, b) in sorted(pairs)[:MOST_LISTED]
    ]


def places(
    edges: Sequence[tuple[int, int]], num_shapes: int
) -> Float[np.ndarray, "s 2"]:
    """A place of each shape in the unit square, so that matched pairs lie near.

    The places minimise the stress sum_ij (|p_i - p_j| - d_ij)^2 / d_ij^2 over the
    plane, d_ij being the number of pairs on the shortest way from i to j, by
    majorisation (Gansner, Koren and North 2004, "Graph drawing by stress
    majorization"). They are the same in every run.

    Args:
        edges: numbers of the two shapes of each pair. What they do not connect is drawn
            apart.
        num_shapes: s, one or more.
    """
    s = num_shapes
    rows = np.array(list(edges), int).reshape(-1, 2)
    near = coo_matrix((np.ones(len(rows)), rows.T), (s, s)).tocsr()
    steps = dijkstra(near, directed=False, unweighted=True)
    far = steps[np.isfinite(steps)].max(initial=1)
    steps = np.where(np.isfinite(steps), steps, far + 1)
    weight = 1 / np.maximum(steps, 1) ** 2
    np.fill_diagonal(weight, 0)
    # On a circle first: no two shapes begin at one place.
    angle = 2 * np.pi * np.arange(s) / s
    points = far / 2 * np.stack([np.cos(angle), np.sin(angle)], 1)
    total = np.maximum(weight.sum(1), 1e-12)[:, None]
    for _ in range(_STEPS if s > 1 else 0):
        offset = points[:, None] - points[None]
        away = np.maximum(np.linalg.norm(offset, axis=2), 1e-9)
        pulled = points[None] + offset * (steps / away)[..., None]
        points = np.einsum("ij,ijd->id", weight, pulled) / total
    # The longer side across.
    points = points - points.mean(0)
    across = np.linalg.eigh(points.T @ points)[1][:, ::-1]
    points = points @ (across * np.sign(across.sum(0) + 1e-12))
    points = points - points.min(0)
    return points / max(points.max(), 1e-9)
