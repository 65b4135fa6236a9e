"""Large shapes are bent as coarse copies first: when, with what result, how often."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from shapes import SMALL, small

import jfsf
from jfsf import Settings, testing
from jfsf.evaluate import geodesic_error
from jfsf.matching import _bent_copies, _pairs
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._coarse import coarse_copy
from jfsf.matching._match import attempted_pair
from jfsf.matching._pairs import PairState
from jfsf.matching._stages import deform_by_arap
from jfsf.runtime._sizes import PaddedShape, spectrum_like

NAMES = "man_walk", "man_up"
SETTINGS = replace(
    SMALL, bend_rounds=8, rigid_below=0, copies_above=800, coarse_vertices=300
)


@cache
def shapes():
    return [small(name, 1500) for name in NAMES]


def pair_of(settings):
    (x, _), (y, _) = shapes()
    return attempted_pair(x, y, settings=settings, cache=False)


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_the_mirror_image_is_bent_too():
    settings = replace(SETTINGS, copies_above=0)
    (x, gt_x), (y, gt_y) = shapes()
    mirrored = y._replace(vertices=y.vertices * [-1.0, 1, 1])
    # Its faces are wound inward now, which `match` mends; the map must mirror.
    found = jfsf.match(
        x, mirrored, orientation="reverse", settings=settings, cache=False
    )
    at = slice(None, None, 10)
    assert geodesic_error(found.T_xy, y, gt_x[at], gt_y[at]).mean() < 0.04
    assert found.certificate.orientation < 0


@pytest.mark.slow
@pytest.mark.usefixtures("run_once")
def test_copies_are_made_once_for_all_attempts(monkeypatch):
    made = []

    def counted(spec, *, settings):
        made.append(len(spec.mass))
        return coarse_copy(spec, settings=settings)

    monkeypatch.setattr(_pairs, "coarse_copy", counted)
    doubtful = replace(SETTINGS, retry_below=1.0, nonisometric_attempts=2)
    state = pair_of(doubtful)
    assert len(made) == 2 and state.copies is not None


def like(n, settings):
    pair = (spectrum_like(PaddedShape(128, n, 2 * n)),) * 2
    return _bent_copies.bends_copies(PairState(pair, MatchInputs()), settings)


def test_which_shapes_have_copies():
    assert [like(n, Settings()) for n in (5120, 102_400)] == [False, True]
    mine = lambda *args, **options: deform_by_arap(*args, **options)
    for other in (
        {"deform": mine},
        {"bend_rounds": 0},
        {"bend_rounds": 2},
        {"copies_above": 10**6},
    ):
        assert not like(102_400, replace(Settings(), **other))


@pytest.mark.parametrize("faces", [0, 9])
def test_a_cloud_beside_a_mesh_has_no_copies(faces):
    mesh = testing.blob_spectrum(0, 40)
    # Faces of padding make no surface.
    cloud = mesh._replace(faces=np.zeros((faces, 3), np.int32))
    settings = replace(SETTINGS, copies_above=100)
    asked = lambda *pair: _bent_copies.bends_copies(
        PairState(pair, MatchInputs()), settings
    )
    assert asked(mesh, mesh)
    assert not asked(mesh, cloud) and not asked(cloud, mesh)


def test_rounds_that_are_none_are_an_error():
    with pytest.raises(ValueError, match="last_rounds is -1; give 0 or more"):
        Settings(last_rounds=-1)
