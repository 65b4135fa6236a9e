"""Refinement of hypotheses on samples of real bodies."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from jfsf import data
from jfsf.initial import SearchSettings
from jfsf.initial._hypotheses import SamplePair, refine_hypotheses
from jfsf.initial._settings import FLIP_KS
from jfsf.matching import basis
from jfsf.spectral import (
    embeddings,
    farthest_points,
    features,
    functional_map,
    truncate,
)

SETTINGS = SearchSettings()


@pytest.mark.slow
def test_zooming_out_from_the_truth_does_not_exchange_hands():
    # With descriptors at full weight it does.
    shapes = [data.load(name) for name in ("woman_up", "woman_walk")]
    specs = [basis(shape.mesh, cache=False) for shape in shapes]
    ats = [np.asarray(farthest_points(spec, num=SETTINGS.samples)) for spec in specs]
    sides = [
        features(spec).at(jnp.asarray(at)) for spec, at in zip(specs, ats, strict=True)
    ]

    points_x, points_y = (shape.mesh.vertices for shape in shapes)
    vertex_x, vertex_y = (shape.template_to_vertex for shape in shapes)
    truth = vertex_y[KDTree(points_x[vertex_x]).query(points_x)[1]]
    few = (truncate(spec, FLIP_KS[0]) for spec in specs)
    start = functional_map(jnp.asarray(truth), *few)

    C_yx = refine_hypotheses(
        SamplePair(*sides, False),
        start[None],
        SETTINGS.descriptor_weight,
        ks=FLIP_KS,
    )[0]
    evecs = (spec.evecs[at] for spec, at in zip(specs, ats, strict=True))
    emb_x, emb_y = embeddings(C_yx, *evecs, space="direct")
    found = ats[1][KDTree(emb_y).query(emb_x)[1]]
    apart = np.linalg.norm(points_y[found] - points_y[truth[ats[0]]], axis=1)
    assert apart.max() < 0.2 * np.ptp(points_y[:, 1])  # body heights
