"""What the beam search of parts is made of, against plain loops."""

import cmath

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jfsf import testing
from jfsf.matching.parts import PartSettings, _samples, cut
from jfsf.matching.parts import _beam as beam
from jfsf.matching.parts._samples import along_cut, part_samples
from jfsf.mesh import surface_area
from jfsf.types import Mesh

WHOLE = testing.blob(3, subdivisions=3)
UNIT = np.sqrt(surface_area(WHOLE))


def samples(mesh: Mesh, num: int):
    return part_samples(Mesh(mesh.vertices / UNIT, mesh.faces), num)


def plain_cost(pair, m: int, partner, scale: float, sign: int, to: int) -> float:
    """Of sample m with the partner `to`: the mean over the samples before it."""
    x, y, which = pair.x, pair.y, pair.which
    turn = x.direction[np.ix_(which, which)]
    parts, before = [], None

    def seen_differently(at, one, two, at_y, one_y, two_y) -> float:
        if pair.touches[at, one] or pair.touches[at, two]:
            return 0.0  # a path along the cut may begin another way in the whole
        angle = turn[at, two] / turn[at, one]
        angle = angle if sign > 0 else angle.conjugate()
        there = y.direction[at_y, two_y] * np.conj(y.direction[at_y, one_y])
        return abs(there - angle) ** 2 / 2

    for j, own in enumerate(partner):
        if own < 0:
            continue
        far_x = scale * x.between[which[m], which[j]]
        off = far_x - y.between[own, to]
        off /= beam.DISTANCE_SLACK + beam.DISTANCE_SHARE * far_x
        y_touches = along_cut(y.around[own, to], y.between[own, to])
        if (pair.touches[m, j] and off > 0) or (y_touches and off < 0):
            off *= beam.SHORTER_WEIGHT
        part = 2 * off**2 / (1 + off**2)
        if before is not None and partner[before] >= 0:
            last = partner[before]
            turned = seen_differently(m, before, j, to, last, own)
            turned += seen_differently(j, before, m, own, last, to)
            part += beam.DIRECTION_WEIGHT * turned / 2
        parts.append(part)
        before = j
    return float(np.mean(parts)) if parts else 0.0


@pytest.mark.parametrize("states", [1, beam.STATES_AT_A_TIME + 3])
@pytest.mark.parametrize("kept", [1.0, 0.8])
def test_the_cost_is_the_mean_of_distances_and_directions(states, kept, monkeypatch):
    # Many paths run along the cut.
    monkeypatch.setattr(_samples, "ALONG_CUT_FACTOR", 1.3)
    monkeypatch.setattr(_samples, "ALONG_CUT_SLACK", 0.1)
    height, across = WHOLE.vertices[:, 2], WHOLE.vertices[:, 0]
    x = samples(cut(WHOLE, height < np.quantile(height, 0.7)).mesh, 40)
    y = samples(cut(WHOLE, across <= np.quantile(across, kept)).mesh, 50)
    pair = beam._Pair(x, y, beam.anchors_of(x, 16))
    assert pair.touches.any() and not pair.touches.all()
    rng, m = np.random.default_rng(0), 5
    partner = rng.integers(-1, 50, (states, m))
    partner[:, 1] = np.where(partner[:, 0] < 0, 0, partner[:, 1])
    scale, sign = rng.uniform(0.7, 1.4, states), rng.choice((1, -1), states)
    found = pair.cost(m, partner, scale, sign)
    assert found.shape == (states, 50)
    for row in {0, states - 1}:
        here = partner[row].tolist()
        for to in (0, 17, 49):
            if to not in here:  # a point has no direction to itself
                wanted = plain_cost(pair, m, here, scale[row], sign[row], to)
                assert found[row, to] == pytest.approx(wanted, abs=2e-5)


def test_an_open_whole_may_lack_the_first_partner():
    """The first sample is at the end that the whole lacks: no other follows from it."""
    x = samples(WHOLE, 60)
    first = x.at[beam.anchors_of(x, 16)[0]]
    far = np.linalg.norm(WHOLE.vertices - WHOLE.vertices[first], axis=1)
    rest = cut(WHOLE, far > np.quantile(far, 0.3))
    y = samples(rest.mesh, 120)
    found = beam.assign(x, y, settings=PartSettings(beam=600))
    at = x.at[found.which]
    best = found.partner[0]
    assert best[0] < 0 and (best >= 0).sum() > 5
    images = rest.index[y.at[best[best >= 0]]]
    off = WHOLE.vertices[images] - WHOLE.vertices[at[best >= 0]]
    assert np.linalg.norm(off, axis=1).mean() / UNIT < 0.1
    # A closed one has it.
    closed = beam.assign(x, samples(WHOLE, 120), settings=PartSettings(beam=600))
    assert (closed.partner[:, 0] >= 0).all()


@given(
    hnp.arrays(
        np.int64,
        st.tuples(st.integers(1, 9), st.integers(3, 6)),
        elements=st.integers(-1, 4),
    )
)
def test_groups_are_told_by_the_first_partners(partner):
    cell = np.array([7, 8, 9, 8, 7, -1])
    wanted = []
    for row in partner.tolist():
        there = [m for m, own in enumerate(row) if own >= 0]
        cells = [int(cell[row[m]]) for m in there[:3]]
        wanted.append([*cells, *[-1] * (3 - len(cells)), *(there or [0])[:1]])
    assert beam._first_partners(partner, 3, cell).tolist() == wanted


@given(
    hnp.arrays(
        np.int64,
        st.tuples(st.integers(1, 30), st.integers(1, 3)),
        elements=st.integers(-1, 3),
    ),
    st.integers(1, 4),
)
def test_the_first_of_each_kind_are_kept(group, most):
    count, wanted = {}, []
    for i, row in enumerate(map(tuple, group.tolist())):
        count[row] = count.get(row, 0) + 1
        wanted += [i] if count[row] <= most else []
    assert beam._first_of_groups(group, most).tolist() == wanted


@given(
    hnp.arrays(
        np.int64, st.tuples(st.integers(1, 12), st.just(4)), elements=st.integers(-1, 9)
    ),
    st.integers(1, 5),
)
def test_assignments_that_are_like_one_before_are_left_out(partner, keep):
    points = np.exp(2j * np.pi * np.arange(10) / 10)
    between = np.array([[abs(cmath.phase(a / b)) for a in points] for b in points])
    wanted: list[int] = []
    for i, row in enumerate(partner):
        apart = []
        for one in wanted:
            both = (row >= 0) & (partner[one] >= 0)
            far = between[row[both], partner[one][both]]
            apart.append(far.mean() if both.any() else 0)
        if len(wanted) < keep and all(a > 0.7 for a in apart):
            wanted.append(i)
    assert beam._different(partner, between, keep, 0.7) == wanted
