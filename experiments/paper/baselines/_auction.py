"""Auction: the assignment of least total squared distance between aligned embeddings.

Bertsekas ("The auction algorithm: a distributed relaxation method for the assignment
problem", Annals of Operations Research, 1988) maximises sum_i b[i, pi(i)] over
one-to-one pi. Bidders without an item bid for the one of most net worth
b[i, j] - p[j]; the highest bid takes the item and raises its price to

    p[j] + (best net worth) - (second best) + eps,

so that no bidder can gain more than eps elsewhere (eps-complementary slackness), and
the result is within n eps of the optimum. Here b = -|emb_x[i] - emb_y[j]|^2. All free
bidders bid at once (Jacobi). eps shrinks in phases. Each keeps the prices, and the
pairs that the smaller eps still allows.

Beyond the source:

- Each bidder keeps the KEEP items of most net worth and a bound on all others. Prices
  never fall, so the bound stays valid, and an exact bid reads only a part of a row.
- With more items than bidders, the items left over must be the cheapest ones. Imaginary
  bidders, to whom every item is worth the same, take them and bid as one (the similar
  persons of Bertsekas and Castanon, Parallel Computing, 1989). That makes the problem
  square, for which prices may be carried from phase to phase.

The dense n_x by n_y benefit is held in float64: 200 MB at n = 5000, where two cores
take 6 to 12 s, and scipy's exact `linear_sum_assignment` over 30 s.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from jfsf.neighbours import NeighbourSearch
from jfsf.types import ArrayLike, Maps

KEEP = 256  # items that are kept for a bidder
SHRINK = 5.0  # eps from phase to phase
START = 0.15  # first eps, in units of the mean squared distance from the centre
BLOCK = 256  # rows of the benefit at a time
# Prices grow; if eps were lost in rounding, the bidding would never end.
FLOOR = 2.0**-36  # of the largest benefit
FREE, FILLED = -1, -2  # an item's holder: nobody, an imaginary bidder


def auction(
    emb_x: Float[Array, "n_x k"],
    emb_y: Float[Array, "n_y k"],
    marginal_x: Float[Array, " n_x"] | None = None,
    marginal_y: Float[Array, " n_y"] | None = None,
    search: NeighbourSearch | None = None,
    *,
    eps: float = 1e-5,
) -> Maps:
    """Match the rows one to one, at the least total squared distance. A converter.

    Runs on the host; inside jit (in `icp` or `zoomout`) by a callback.

    Args:
        emb_x, emb_y: aligned embeddings.
        marginal_x, marginal_y: 0 marks padding, which is never assigned and is mapped
            to 0; other values do not matter. Rows that are not finite count as padding.
        search: ignored; all rows are compared.
        eps: the total is within n eps of the least, for n rows on the smaller side, in
            units of the mean squared distance of all rows from their centre.

    Returns:
        Every row of the smaller side has a row of its own, and there T_xy and T_yx are
        inverse. The other rows of the larger side take their nearest neighbour.

    Raises:
        ValueError: shapes do not fit, or eps is not positive.
    """
    if emb_x.ndim != 2 or emb_y.ndim != 2 or emb_x.shape[1] != emb_y.shape[1]:
        raise ValueError(
            f"auction: emb_x is {emb_x.shape} and emb_y {emb_y.shape}, expected "
            "(n_x, k) and (n_y, k)"
        )
    for name, marginal, emb in (("x", marginal_x, emb_x), ("y", marginal_y, emb_y)):
        if marginal is not None and marginal.shape != (len(emb),):
            raise ValueError(
                f"auction: marginal_{name} has shape {marginal.shape}, emb_{name} has "
                f"{len(emb)} rows"
            )
    if not eps > 0:
        raise ValueError(f"auction: eps is {eps}, it must be positive")

    args = emb_x, emb_y, _valid(marginal_x, emb_x), _valid(marginal_y, emb_y)
    if any(isinstance(a, Tracer) for a in args):
        maps = [jax.ShapeDtypeStruct((len(e),), jnp.int32) for e in (emb_x, emb_y)]
        host = partial(_auction, eps=eps)
        return Maps(*jax.pure_callback(host, maps, *args, vmap_method="sequential"))
    return Maps(*map(jnp.asarray, _auction(*args, eps=eps)))


def one_to_one(
    benefit: Float[np.ndarray, "n_x n_y"], *, eps: float, start: float
) -> tuple[Int[np.ndarray, " n_x"], Int[np.ndarray, " n_y"]]:
    """`assign` the smaller side; other rows of the larger side take their best.

    Returns:
        The column of each row and the row of each column.
    """
    if len(benefit) > benefit.shape[1]:
        to_x, to_y = one_to_one(np.ascontiguousarray(benefit.T), eps=eps, start=start)
        return to_y, to_x
    to_y, to_x = assign(benefit, eps=eps, start=start), benefit.argmax(0)
    to_x[to_y] = np.arange(len(benefit))
    return to_y, to_x


def assign(
    benefit: Float[np.ndarray, "n m"], *, eps: float, start: float
) -> Int[np.ndarray, " n"]:
    """A different item for each bidder, of total benefit within n eps of the most.

    Args:
        benefit: finite, at least as many items m as bidders n; rows contiguous.
        eps: of the last phase, raised to `FLOOR` of the largest benefit if below it.
        start: eps of the first phase; about as large as differences of benefits.

    Raises:
        ValueError: more bidders than items, or eps is not positive.
    """
    n, m = benefit.shape
    if n > m or not eps > 0:
        raise ValueError(
            f"assign: {n} bidders for {m} items with eps {eps}; there must be an item "
            "a bidder (transpose the benefit), and eps must be positive"
        )
    if n == 0:
        return np.zeros(0, np.int64)
    # Each of the imaginary bidders may also be eps away from its best.
    eps = max(eps * n / m, FLOOR * float(np.abs(benefit).max()))
    bidders = _Bidders(benefit)
    price = np.zeros(m)
    item, holder = np.full(n, FREE), np.full(m, FREE)
    step = max(start, eps)
    while True:
        holder[holder == FILLED] = FREE
        held = np.flatnonzero(item != FREE)
        _, best, _ = bidders.best_two(held, price)
        worth = benefit[held, item[held]] - price[item[held]]
        unhappy = held[worth < best - step]
        holder[item[unhappy]], item[unhappy] = FREE, FREE
        _bid(bidders, price, item, holder, step)
        while _fill(price, item, holder, m - n, step):
            _bid(bidders, price, item, holder, step)
        if step <= eps:
            break
        step = max(step / SHRINK, eps)
    return item


class _Bidders:
    """The items of most net worth to each bidder, while prices only rise.

    items, worth: the KEEP best items at the last full search, and their benefits.
    bound: net worth that no other item exceeds.
    """

    def __init__(self, benefit):
        n, m = benefit.shape
        self.benefit, self.keep = benefit, min(KEEP, m)
        self.items = np.zeros((n, self.keep), np.int64)
        self.worth = np.zeros((n, self.keep))
        self.bound = np.full(n, np.inf)

    def best_two(self, who, price):
        """The best item of each of `who`, its net worth, and the second best's."""
        found = self._among_kept(who, price)
        stale = np.flatnonzero(found[2] < self.bound[who])
        if not len(stale):
            return found
        for at in range(0, len(stale), BLOCK):
            self._search_all(who[stale[at : at + BLOCK]], price)
        for old, new in zip(found, self._among_kept(who[stale], price), strict=True):
            old[stale] = new
        return found

    def _among_kept(self, who, price):
        items, row = self.items[who], np.arange(len(who))
        net = self.worth[who] - price[items]
        at = net.argmax(1)
        best = net[row, at]
        net[row, at] = -np.inf
        second = net.max(1)
        # With a single item there is no second best.
        return items[row, at], best, np.where(second > -np.inf, second, best)

    def _search_all(self, who, price):
        worth = self.benefit[who]
        net, rest = worth - price, len(price) - self.keep
        if rest:
            items = np.argpartition(net, rest - 1, axis=1)[:, rest - 1 :]
            self.bound[who] = np.take_along_axis(net, items[:, :1], 1)[:, 0]
            items = items[:, 1:]
        else:
            items = np.broadcast_to(np.arange(len(price)), net.shape)
            self.bound[who] = -np.inf
        self.items[who] = items
        self.worth[who] = np.take_along_axis(worth, items, 1)


def _bid(bidders, price, item, holder, eps):
    """Bid until every bidder holds an item. Changes price, item and holder."""
    waiting = np.flatnonzero(item == FREE)
    highest = np.empty(len(price), np.int64)
    while len(waiting):
        wanted, best, second = bidders.best_two(waiting, price)
        bid = price[wanted] + (best - second) + eps
        order = np.argsort(bid, kind="stable")
        highest[wanted[order]] = order  # of repeated items the last one is kept
        won = highest[wanted] == np.arange(len(waiting))
        taken, winner = wanted[won], waiting[won]
        loser = holder[taken]
        loser = loser[loser >= 0]
        price[taken], holder[taken], item[winner] = bid[won], winner, taken
        item[loser] = FREE
        waiting = np.concatenate([waiting[~won], loser])


def _fill(price, item, holder, count, eps):
    """Let `count` imaginary bidders hold the cheapest items; False if all had one.

    They bid as one, so the second best is an item that none of them holds.
    """
    missing = count - int((holder == FILLED).sum())
    if missing == 0:
        return False
    others = np.flatnonzero(holder != FILLED)
    order = np.argpartition(price[others], missing)
    taken, rival = others[order[:missing]], others[order[missing]]
    loser = holder[taken]
    item[loser[loser >= 0]] = FREE
    price[taken], holder[taken] = price[rival] + eps, FILLED
    return True


def _auction(emb_x, emb_y, valid_x, valid_y, *, eps):
    emb_x, emb_y = np.asarray(emb_x, np.float64), np.asarray(emb_y, np.float64)
    real_x, real_y = np.flatnonzero(valid_x), np.flatnonzero(valid_y)
    T_xy, T_yx = np.zeros(len(emb_x), np.int32), np.zeros(len(emb_y), np.int32)
    if not (len(real_x) and len(real_y)):
        return [T_xy, T_yx]
    x, y = emb_x[real_x], emb_y[real_y]
    centre = np.concatenate([x, y]).mean(0)
    x, y = x - centre, y - centre
    spread = (np.sum(x**2) + np.sum(y**2)) / (len(x) + len(y)) or 1.0
    benefit = 2 * (x @ y.T) - np.sum(x**2, 1)[:, None] - np.sum(y**2, 1)
    to_y, to_x = one_to_one(benefit, eps=eps * spread, start=START * spread)
    T_xy[real_x], T_yx[real_y] = real_y[to_y], real_x[to_x]
    return [T_xy, T_yx]


def _valid(marginal: ArrayLike | None, emb: ArrayLike):
    finite = jnp.isfinite(emb).all(1)
    return finite if marginal is None else finite & (marginal > 0)
