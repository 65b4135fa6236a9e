"""Which of the attempts are alternatives, and in which order."""

import numpy as np
import pytest
from scipy.special import logit
from shapes import small

import jfsf
from jfsf import Settings, testing
from jfsf.matching import _match
from jfsf.matching._arguments import MatchInputs
from jfsf.matching._pairs import Attempt, PairState, Standing
from jfsf.runtime._sizes import padded_pair
from jfsf.types import Certificate, Match

MESH = testing.blob(0)
N = len(MESH.vertices)
SAME = np.arange(N)
# A vertex and its neighbour, and the vertices farthest from each.
NEAR = np.where(np.isin(SAME, MESH.faces[0]), MESH.faces[0][0], SAME)
FAR = np.linalg.norm(MESH.vertices[:, None] - MESH.vertices[None], axis=2).argmax(1)


def found(T_xy, confidence):
    figures = dict.fromkeys(Certificate._fields, np.zeros(()))
    figures |= {"confidence": np.array(confidence), "landmarks": np.zeros(0)}
    figures |= {"log_odds": logit(confidence), "share": np.array(np.nan)}
    return Match(T_xy, T_xy, np.eye(3), Certificate(**figures))


@pytest.fixture
def attempts(monkeypatch):
    """A function that says what is attempted, in order."""
    spec = jfsf.basis(MESH, cache=False)

    def set_to(*matches, share=np.nan):
        pair = PairState(padded_pair(spec, spec), MatchInputs())
        size = len(pair.spectra[0].mass)
        for match in matches:
            T_xy = np.pad(match.T_xy, (0, size - N))
            match = match._replace(T_xy=T_xy, T_yx=T_xy)
            pair.keep(Attempt("search", None, match), settings=Settings())
        pair.standings[-1] = Standing(share)
        monkeypatch.setattr(_match, "attempted", lambda *args: pair)

    return set_to


def test_the_most_confident_is_first_and_none_is_like_another(attempts):
    attempts(found(FAR, 0.3), found(SAME, 0.4), found(NEAR, 0.8))
    tried = jfsf.alternatives(MESH, MESH)
    likely = [float(match.certificate.confidence) for match in tried]
    np.testing.assert_allclose(likely, [0.8, 0.3])
    assert [int(match.info.won) for match in tried] == [2, 0]
    assert np.array_equal(tried[0].T_xy, NEAR) and np.array_equal(tried[1].T_xy, FAR)
    np.testing.assert_allclose(tried[0].info.confidence, [0.3, 0.4, 0.8])


def test_all_are_kept_on_request(attempts):
    attempts(found(FAR, 0.3), found(SAME, 0.4), found(SAME, 0.4), found(NEAR, np.nan))
    tried = jfsf.alternatives(MESH, MESH, min_distance=0)
    # Ties in the order of the attempts; what has no confidence comes last.
    assert [int(match.info.won) for match in tried] == [1, 2, 0, 3]


def test_that_of_match_is_first_whatever_its_confidence(attempts):
    # It was compared with rivals later, and the other was not.
    attempts(found(SAME, 0.2), found(FAR, 0.3), share=0.01)
    tried = jfsf.alternatives(MESH, MESH, min_distance=0)
    assert [int(match.info.won) for match in tried] == [1, 0]
    likely = [float(match.certificate.confidence) for match in tried]
    assert likely[0] < likely[1] == pytest.approx(0.2)


def test_what_cannot_be_matched_is_an_error():
    few = MESH._replace(vertices=MESH.vertices[:100], faces=MESH.faces[:0])
    with pytest.raises(jfsf.MeshError, match="mesh_y"):
        jfsf.alternatives(MESH, few)
    with pytest.raises(ValueError, match="landmarks"):
        jfsf.alternatives(MESH, MESH, landmarks=np.array([[0, N]]))


@pytest.mark.slow  # all attempts of a pair, twice
def test_they_are_the_maps_that_match_chooses_from():
    (x, _), (y, _) = small("man_walk", 1100), small("man_up", 1060)
    doubtful = Settings(retry_below=1.0, nonisometric_attempts=3)
    found = jfsf.match(x, y, settings=doubtful, cache=False)
    tried = jfsf.alternatives(x, y, settings=doubtful, cache=False, min_distance=0)
    assert np.array_equal(tried[0].T_xy, found.T_xy)
    assert tried[0].info.won == found.info.won
    numbers = sorted(int(match.info.won) for match in tried)
    assert numbers == list(range(len(found.info.source))) and len(numbers) > 2
    for match in tried:
        assert len(match.T_xy) == len(x.vertices) and len(match.T_yx) == len(y.vertices)
        assert match.info.sources == found.info.sources
