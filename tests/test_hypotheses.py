"""What hypotheses become on samples of real bodies."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from jfsf import data
from jfsf.descriptors import wks
from jfsf.fmap import embeddings, functional_map, truncate
from jfsf.hypotheses import Samples, Seen
from jfsf.match import basis
from jfsf.pipeline import EVERY
from jfsf.sampling import farthest_points
from jfsf.search import EXTRA_WEIGHT, SAMPLES, SECOND


def test_zooming_out_from_the_truth_does_not_exchange_hands():
    # With descriptors at full weight it does.
    shapes = [data.load(name) for name in ("woman_up", "woman_walk")]
    specs = [basis(shape.mesh, cache=False) for shape in shapes]
    ats = [np.asarray(farthest_points(spec, num=SAMPLES)) for spec in specs]
    seen = [
        Seen.of(spec, wks(spec)[:, ::EVERY], False).at(jnp.asarray(at))
        for spec, at in zip(specs, ats, strict=True)
    ]

    points_x, points_y = (shape.mesh.vertices for shape in shapes)
    vertex_x, vertex_y = (shape.template_to_vertex for shape in shapes)
    truth = vertex_y[KDTree(points_x[vertex_x]).query(points_x)[1]]
    few = (truncate(spec, SECOND[0]) for spec in specs)
    start = functional_map(jnp.asarray(truth), *few)

    C_yx = Samples(*seen, False).zoom(start[None], SECOND, EXTRA_WEIGHT)[0]
    evecs = (spec.evecs[at] for spec, at in zip(specs, ats, strict=True))
    emb_x, emb_y = embeddings(C_yx, *evecs, space="direct")
    found = ats[1][KDTree(emb_y).query(emb_x)[1]]
    apart = np.linalg.norm(points_y[found] - points_y[truth[ats[0]]], axis=1)
    assert apart.max() < 0.2 * np.ptp(points_y[:, 1])  # body heights
