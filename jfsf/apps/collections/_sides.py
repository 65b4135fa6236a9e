"""Which shapes of a collection are mirror images of the template: left bones or right.

The maps of a mirror image to the other side are mostly in doubt and say that their own
mirror image is likely; one of them may be wrong and sure all the same. So no map
decides alone: each matched pair votes for the same side or for different ones, and the
shapes are divided so that the votes are met best. Spectra, which choose the pairs, are
those of the mirror image too, so left and right are spread over the pairs as by chance:
a division of s shapes into k and s - k is one of s! / (k! (s - k)!) that are equally
likely beforehand. Its votes must outweigh that number. A few maps between two groups of
bodies in many poses do not; those between left and right bones do.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.special import gammaln, logit

from jfsf.apps.collections._cycles import LEAST, Edge, edge_of
from jfsf.apps.collections._grow import Matched, MirrorTest


def votes(
    matched: Mapping[Edge, Matched], tests: Iterable[MirrorTest] = ()
) -> dict[Edge, float]:
    """Log odds that both shapes of a pair are on the same side.

    The map says so by its confidence, and the reverse by the probability of its mirror
    image. What is less likely than not does not vote. Where one shape was mirrored and
    matched again, that decides: a mirror image that fits far better has the more
    certain of both votes against the map, and one that does not has none.

    Args:
        matched: the pairs.
        tests: of a pair's two tests the one that finds a mirror image counts.
    """
    found = {
        e: _sure(one.confidence) - _sure(one.mirrored) for e, one in matched.items()
    }
    for test in sorted(tests, key=lambda test: test.mirrors):
        edge = edge_of(test.shape, test.partner)
        if test.mirrors:
            found[edge] = min(found.get(edge, 0), -_sure(test.turned))
        else:
            found[edge] = _sure(test.straight)
    return found


def sides(
    vote: Mapping[Edge, float], num_shapes: int, template: int
) -> Int[np.ndarray, " s"]:
    """1 for the shapes on the side of the template, and -1 for mirror images.

    Found by local search from two starts: all on one side, and each shape where those
    before it vote. As long as that is more likely, one shape changes sides, or a group
    does whose votes for one side are met.

    Args:
        vote: of each pair, see `votes`.
        num_shapes: shapes, numbered from 0.
        template: the number of the shape on side 1.
    """
    edges = np.array(sorted(vote), int).reshape(-1, 2)
    strength = np.array([vote[a, b] for a, b in edges.tolist()])
    starts = np.ones(num_shapes, int), _by_votes(edges, strength, num_shapes)
    found = [_improved(edges, strength, start) for start in starts]
    side = min(found, key=lambda side: _cost(edges, strength, side))
    return side * side[template]


def _by_votes(edges, strength, num_shapes: int) -> np.ndarray:
    """Each shape where those before it vote; next is the one with the clearest vote."""
    graph = coo_matrix((strength, edges.T), (num_shapes, num_shapes)).tocsr()
    graph = (graph + graph.T).tolil()
    side, total = np.zeros(num_shapes, int), np.zeros(num_shapes)
    while (side == 0).any():
        i = int(np.where(side == 0, np.abs(total), -1).argmax())
        side[i] = -1 if total[i] < 0 else 1
        total[graph.rows[i]] += side[i] * np.array(graph.data[i])
    return side


def _improved(edges, strength, side) -> np.ndarray:
    """Local search; every step makes it more likely."""
    side, alone = side.copy(), np.arange(len(side))
    while True:
        agrees = strength * side[edges].prod(1)
        met = edges[(strength > 0) & (agrees > 0)]
        graph = coo_matrix((np.ones(len(met)), met.T), (len(side), len(side)))
        groups = connected_components(graph, directed=False)[1]
        steps = []
        for group in (alone, groups):
            change = _changes(edges, agrees, side, group)
            steps.append((change.min(), group == change.argmin()))
        least, which = min(steps, key=lambda step: step[0])
        if least > -1e-9:
            return side
        side[which] *= -1


def _changes(edges, agrees, side, group) -> np.ndarray:
    """By group, the change of `_cost` if it changes sides."""
    a, b = group[edges].T
    between, number = a != b, group.max() + 1
    lost = np.bincount(a[between], agrees[between], number)
    lost += np.bincount(b[between], agrees[between], number)
    k = int((side < 0).sum())
    turned = k + np.bincount(group, side, number)
    return lost + _log_ways(len(side), turned) - _log_ways(len(side), k)


def _cost(edges, strength, side) -> float:
    """Negative log likelihood, but for a constant."""
    agreed = float(strength @ side[edges].prod(1))
    return float(_log_ways(len(side), (side < 0).sum())) - agreed / 2


def _log_ways(s: int, k):
    """Logarithm of the number of ways to choose k of s."""
    return gammaln(s + 1) - gammaln(k + 1) - gammaln(s - k + 1)


def _sure(probability: float) -> float:
    """Log odds, 0 below one half and where it is not known."""
    return float(logit(np.clip(np.nan_to_num(probability), 0.5, 1 - LEAST)))
