"""Candidates of the search -> the map: refine the close ones, keep the best.

What a map tears, what it turns over against the rest, and where it bends the surface
otherwise, shows when it is refined: a thousand samples are too few. So the best
candidate is not refined alone, but with the rivals that nearly reach its energy.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.convert import brief, sinkhorn
from jfsf.descriptors import curvature, standardise
from jfsf.fmap import embeddings, functional_map, truncate, uniform
from jfsf.orientation import bracket_fields, turned_over
from jfsf.refine import zoomout
from jfsf.sampling import biharmonic, restrict, tile_points
from jfsf.search import Candidates
from jfsf.tiles import spectral_tiles
from jfsf.types import Filtered, Maps, Spectrum, Tiles

# The rounds in place, where descriptors weigh most, clean the start up; finer schedules
# drift further from it.
KS = (30,) * 6 + (45, 45, 65, 65, 110, 200, 200)
TILED = 2000  # vertices above which neighbours are searched among candidates
LARGE = 20_000  # vertices above which C_yx is refined on samples
REFINED = 4000  # samples, up to twice as many
RIVALS = 3  # candidates that are refined, at most
CLOSE = 0.12  # excess energy, relative, up to which they are
TURNED = 1.5  # energy of a map all of which were turned over
STRETCHED = 0.015  # energy of edges e times as long, in the square
BENT = 0.3  # energy of curvatures that differ by one standard deviation


class Finished(NamedTuple):
    """The map of the best candidate.

    filtered: maps both ways, and their plan.
    aligned: the functional map that was converted to them.
    C_yx: the functional map of filtered.T_xy.
    gap: by how much more energy the runner-up has, relative.
    """

    filtered: Filtered
    aligned: Float[Array, "k k"]
    C_yx: Float[Array, "k k"]
    gap: Float[Array, ""]


def finish(
    spec_x: Spectrum,
    spec_y: Spectrum,
    look_x: Float[Array, "n_x e"],
    look_y: Float[Array, "n_y e"],
    found: Candidates,
) -> Finished:
    """Refine the best candidates, choose one, and convert it in full.

    Neighbours are searched among candidates above `TILED` vertices, and functional maps
    refined on samples above `LARGE`.

    Args:
        spec_x, spec_y: as many eigenpairs of each; mass 0 is padding.
        look_x, look_y: columns beside the eigenfunctions (`search.appearance`).
        found: the best first.
    """
    num = min(RIVALS, len(found.energy))
    close = found.energy[:num] <= (1 + CLOSE) * found.energy[0]
    starts = found.C_yx[:num], found.orientation[:num]
    refine = _refiner(spec_x, spec_y, look_x, look_y)
    # In a loop, so that it is one program however many there are.
    blank = jax.tree.map(
        lambda a: jnp.zeros(a.shape, a.dtype),
        jax.eval_shape(refine, *(a[0] for a in starts)),
    )
    each, extra = jax.lax.map(
        lambda one: jax.lax.cond(one[0], refine, lambda *_: blank, *one[1]),
        (close, starts),
    )
    extra = jnp.asarray(extra)
    best = jnp.where(close, found.energy[:num] + extra, jnp.inf).argmin()
    # A rival that was not refined passes for as smooth as the best.
    extra = jnp.where(close, extra, extra[best])
    energy = (found.energy + extra[best]).at[:num].add(extra - extra[best])
    gap = jnp.min(energy.at[best].set(jnp.inf)) / energy[best] - 1
    filtered, aligned, C_yx = jax.tree.map(lambda a: a[best], each)
    return Finished(filtered, aligned, C_yx, gap)


def _refiner(spec_x, spec_y, look_x, look_y):
    """(C_yx, orientation) -> (filtered, aligned, C_yx), energy."""
    fields = bracket_fields(spec_x), bracket_fields(spec_y)
    seen, columns = (spec_x, spec_y), (look_x, look_y, *fields)
    tiles = seen_tiles = _tiles(spec_x, spec_y)
    if max(len(spec_x.mass), len(spec_y.mass)) > LARGE:
        at = [tile_points(s, num=min(REFINED, len(s.mass))) for s in seen]
        columns = [a[at[i % 2]] for i, a in enumerate(columns)]
        seen = restrict(spec_x, at[0]), restrict(spec_y, at[1])
        seen_tiles = _tiles(*seen)
    widest = len(spec_x.evals)
    bent_x, bent_y = (standardise(curvature(s), s.mass) for s in (spec_x, spec_y))

    def refine(C_yx, orientation):
        # Point clouds have no orientation; nan must not reach the embeddings.
        way = jnp.sign(jnp.nan_to_num(orientation))
        looks, (field_x, field_y) = columns[:2], columns[2:]
        aligned = zoomout(
            *seen,
            C_yx,
            *looks,
            way * field_x,
            field_y,
            ks=tuple(min(k, widest) for k in KS),
            converter=brief,
            weighted=True,
            tiles=seen_tiles,
        )
        embs = embeddings(aligned, spec_x.evecs, spec_y.evecs, space="direct")
        marginals = uniform(spec_x.mass), uniform(spec_y.mass)
        filtered = sinkhorn(*embs, *marginals, tiles=tiles)
        maps = Maps(filtered.T_xy, filtered.T_yx)
        C_yx = functional_map(maps.T_xy, truncate(spec_x, widest), spec_y)
        turned = way * fields[0], fields[1]
        over = turned_over(maps, C_yx, *turned, spec_x.mass, spec_y.mass)
        energy = TURNED * over + STRETCHED * _stretch(maps, spec_x, spec_y)
        energy += BENT * _differ(maps, bent_x, bent_y, spec_x.mass, spec_y.mass)
        return (filtered, aligned, C_yx), energy

    return refine


def _stretch(maps: Maps, spec_x: Spectrum, spec_y: Spectrum):
    """Log of how many times longer, in the square, edges become; mean of both ways."""
    points_x, points_y = biharmonic(spec_x), biharmonic(spec_y)

    def squares(points, at):
        # One edge of each face: all three say no more.
        return jnp.sum((points[at[:, 0]] - points[at[:, 1]]) ** 2)

    def one(T, faces, here, there):
        before, after = squares(here, faces), squares(there, T[faces])
        # A point cloud has no edges.
        known = (before > 0) & (after > 0)
        return jnp.where(known, jnp.log(jnp.where(known, after / before, 1)), 0)

    there = one(maps.T_xy, spec_x.faces, points_x, points_y)
    return (there + one(maps.T_yx, spec_y.faces, points_y, points_x)) / 2


def _differ(maps: Maps, one_x, one_y, mass_x, mass_y):
    """Mean square difference of columns through the maps, summed over both ways."""
    there = mass_x @ jnp.mean((one_x - one_y[maps.T_xy]) ** 2, 1)
    return there + mass_y @ jnp.mean((one_y - one_x[maps.T_yx]) ** 2, 1)


def _tiles(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Tiles, Tiles] | None:
    if max(len(spec_x.mass), len(spec_y.mass)) <= TILED:
        return None
    return spectral_tiles(spec_x), spectral_tiles(spec_y)
