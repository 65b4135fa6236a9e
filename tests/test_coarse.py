"""Coarse copies: doubtful large shapes are matched by way of smaller ones."""

from typing import NamedTuple

import numpy as np
import pytest

import jfsf
from jfsf.arguments import MatchInputs
from jfsf.data import load
from jfsf.evaluate import evaluate
from jfsf.matching import _coarse, _match
from jfsf.runtime import PaddedShape
from jfsf.settings import Settings
from jfsf.types import Match

X, Y = load("man_walk").mesh, load("man_up").mesh


class ScoreOnly(NamedTuple):
    """What is read of a certificate."""

    orientation: np.ndarray


# No map is confident enough, and shapes of some 5000 vertices are large.
DOUBTFUL = Settings(coarse_vertices=1000, retry_below=1.0)
COPY_X, COPY_Y = (_coarse.coarse_copy(mesh, DOUBTFUL) for mesh in (X, Y))
CLOUD = X._replace(faces=X.faces[:0])


@pytest.mark.parametrize(
    ("other", "vertices", "expected"),
    [(Y, 2560, False), (Y, 5120, True), (CLOUD, 5120, False)],
)
def test_large_surfaces_have_copies(other, vertices, expected):
    sizes = [PaddedShape(128, vertices, 2 * vertices)]
    assert _coarse.have_copies([X, other], sizes, DOUBTFUL) is expected
    assert not _coarse.have_copies([X, other], sizes, Settings(coarse_vertices=0))


def test_a_copy_lies_on_the_whole():
    whole, copy = X.vertices, COPY_X.mesh.vertices
    assert 900 < len(copy) < 1025
    assert COPY_X.on_whole.shape == (len(copy),) and COPY_X.on_copy.shape == (5076,)
    near = np.linalg.norm(whole[COPY_X.on_whole] - copy, axis=1)
    assert near.max() < 0.05
    np.testing.assert_allclose(
        near, np.linalg.norm(whole[:, None] - copy[None], axis=2).min(0)
    )


def test_arguments_move_to_the_copies():
    landmarks = np.array([3, 70]), np.array([8, 20])
    descriptors = X.vertices, Y.vertices
    given = MatchInputs(landmarks, descriptors)
    found = _coarse.at_copies(given, COPY_X, COPY_Y)
    for copy, mesh, at, there in zip(
        (COPY_X, COPY_Y), (X, Y), landmarks, found.landmarks, strict=True
    ):
        away = copy.mesh.vertices[np.asarray(there)] - mesh.vertices[at]
        assert np.linalg.norm(away, axis=1).max() < 0.2
    for copy, values in zip((COPY_X, COPY_Y), found.descriptors, strict=True):
        assert np.linalg.norm(values - copy.mesh.vertices, axis=1).max() < 0.05


def test_a_start_is_the_map_of_the_copies():
    spec = jfsf.basis(X)
    same = np.arange(len(COPY_X.mesh.vertices))
    found = Match(same, same, None, ScoreOnly(np.array(0.9)))
    start = _coarse.start_from_copies(
        found, (COPY_X, COPY_X), spec, spec, settings=Settings()
    )
    assert start.C_yx.shape == (40, 40)
    # The identity, but for the distance between vertices of the copy.
    assert np.abs(np.diagonal(start.C_yx)[:20]).min() > 0.9
    assert float(start.sign) == 1


@pytest.fixture(scope="module")
def by_copies():
    names = []
    found = jfsf.match(X, Y, settings=DOUBTFUL, progress=names.append)
    return found, names


def test_a_doubtful_pair_is_matched_by_way_of_its_copies(by_copies):
    found, names = by_copies
    assert names.count("coarse copies") == 1
    # The first map, those of the copies, and one more.
    attempts = 1 + (1 + DOUBTFUL.nonisometric_attempts) + 1
    assert names.count("refinement") == attempts
    assert names.count("bending and conversion") == attempts
    # Further starts are compared before, on the copies.
    assert names.count("screening") == 1
    assert found.info.sources == ["search", "coarse copies"]
    assert len(found.info.confidence) == 2 and found.info.won in (0, 1)
    plain = jfsf.match(X, Y, settings=Settings(retry_below=0))
    assert found.certificate.confidence >= plain.certificate.confidence
    truth = load("man_walk").template_to_vertex, load("man_up").template_to_vertex
    scores = evaluate(found, X, Y, truth=truth, every=20, only=("error",))
    assert scores.error_mean < 0.015


def test_a_pair_without_doubt_has_no_copies():
    names = []
    settings = Settings(coarse_vertices=1000)
    jfsf.match(X, Y, settings=settings, progress=names.append)
    assert "coarse copies" not in names


def test_where_the_copy_is_broken_the_whole_is_tried(monkeypatch):
    def broken(mesh, settings):
        copy = _coarse.coarse_copy(mesh, settings)
        return copy._replace(mesh=copy.mesh._replace(faces=copy.mesh.faces[:100]))

    monkeypatch.setattr(_match, "coarse_copy", broken)
    names = []
    jfsf.match(X, Y, settings=DOUBTFUL, progress=names.append)
    assert names.count("spectra") == 1
    assert names.count("refinement") == 1 + DOUBTFUL.nonisometric_attempts


def test_few_coarse_vertices_are_an_error():
    with pytest.raises(ValueError, match="coarse_vertices is 100; give 0, or 160"):
        Settings(coarse_vertices=100)
    assert Settings(coarse_vertices=0).coarse_vertices == 0
