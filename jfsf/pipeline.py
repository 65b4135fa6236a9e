"""Spectra -> Match: search, refinement, conversion. Pure, jitted."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from jfsf.certificate import certify
from jfsf.convert import brief, brief_nearest, sinkhorn
from jfsf.descriptors import hks, wks
from jfsf.fmap import embeddings, functional_map, truncate, uniform
from jfsf.hypotheses import Seen
from jfsf.refine import arap, zoomout
from jfsf.sampling import restrict, tile_points
from jfsf.search import HYPOTHESES, Orientation, check_search, search_seen, way_of
from jfsf.sides import both
from jfsf.tiles import spectral_tiles
from jfsf.types import Match, Spectrum, Tiles

K = 128  # eigenpairs a shape; more make a better map before `arap`, hardly after it
# The rounds in place, where descriptors weigh most, clean the start up. Finer schedules
# slide further from it; coarser ones are as good once `arap` has followed.
KS = (30,) * 4 + (45, 65, 110, K)
EVERY = 5  # one WKS energy in so many: neighbours say nearly the same
TILED = 2000  # vertices above which neighbours are searched among candidates
LARGE = 20_000  # vertices above which C_yx is refined on samples
REFINED = 4000  # samples, up to twice as many
LEAST = 0.95  # recall below which, up to `LARGE`, all points are compared


def match_spectra(
    spec_x: Spectrum,
    spec_y: Spectrum,
    landmarks: Int[Array, "l 2"] | None = None,
    *,
    orientation: Orientation | Int[Array, ""] = "preserve",
    hypotheses: int = HYPOTHESES,
    itself: Bool[Array, ""] | bool = False,
) -> Match:
    """`jfsf.match` from the spectra on: pure, so it vmaps over pairs of equal size.

    Args:
        spec_x, spec_y: 40 eigenpairs or more, as many of each; mass 0 is padding.
            Neighbours are searched among candidates above `TILED` vertices, and C_yx
            is refined on samples above `LARGE`.
        landmarks, hypotheses: as `jfsf.match`.
        orientation, itself: as `search`; neither compiles anew.
    """
    way = way_of(orientation)
    return _match_spectra(spec_x, spec_y, landmarks, way, itself, hypotheses=hypotheses)


@partial(jax.jit, static_argnames="hypotheses")
def _match_spectra(spec_x, spec_y, landmarks, way, itself, *, hypotheses):
    check_search(spec_x, spec_y, hypotheses)
    at_x, at_y = (None, None) if landmarks is None else landmarks.T
    look_x, look_y = both(
        lambda spec, at: Seen.of(spec, _descriptors(spec, at), itself),
        (spec_x, at_x),
        (spec_y, at_y),
    )
    found = search_seen(look_x, look_y, way, itself, hypotheses=hypotheses)
    widest = min(len(spec_x.evals), len(spec_y.evals))
    ks = tuple(min(k, widest) for k in KS)
    # Point clouds have no orientation; nan must not reach the embeddings.
    turned = jnp.sign(jnp.nan_to_num(found.orientation[0]))
    start = (
        found.C_yx[0],
        look_x.extra,
        look_y.extra,
        turned * look_x.field,
        look_y.field,
    )
    tiles = seen_tiles = _tiles(spec_x, spec_y)
    seen_x, seen_y = spec_x, spec_y
    if max(len(spec_x.mass), len(spec_y.mass)) > LARGE:
        at_x, at_y = (
            tile_points(spec, num=min(REFINED, len(spec.mass)))
            for spec in (spec_x, spec_y)
        )
        seen_x, seen_y = restrict(spec_x, at_x), restrict(spec_y, at_y)
        C_yx, extra_x, extra_y, field_x, field_y = start
        start = C_yx, extra_x[at_x], extra_y[at_y], field_x[at_x], field_y[at_y]
        seen_tiles = _tiles(seen_x, seen_y)
    C_yx = zoomout(
        seen_x,
        seen_y,
        *start,
        ks=ks,
        converter=brief,
        weighted=True,
        tiles=seen_tiles,
    )
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)
    if len(spec_x.faces) and len(spec_y.faces):
        maps = brief_nearest(emb_x, emb_y, *marginals, tiles=tiles)
        handed = jnp.where(turned < 0, -1.0, 1.0)
        emb_x, emb_y = arap(
            spec_x, spec_y, maps, handed, converter=brief_nearest, tiles=tiles
        )
    # To compare a million points with all would take hours.
    least = 0.0 if max(len(spec_x.mass), len(spec_y.mass)) > LARGE else LEAST
    filtered = sinkhorn(emb_x, emb_y, *marginals, tiles=tiles, least=least)
    C_yx = functional_map(filtered.T_xy, truncate(spec_x, widest), spec_y)
    gap = found.energy[1] / found.energy[0] - 1
    certificate = certify(filtered, emb_x, emb_y, C_yx, spec_x, spec_y, gap)
    return Match(filtered.T_xy, filtered.T_yx, C_yx, certificate)


def _descriptors(spec: Spectrum, landmarks) -> Array:
    desc = wks(spec)[:, ::EVERY]
    if landmarks is None:
        return desc
    # Heat from a landmark is positive up to the cut of the spectrum.
    return jnp.concatenate([desc, jnp.maximum(hks(spec, landmarks, num=10), 0)], 1)


def _tiles(spec_x: Spectrum, spec_y: Spectrum) -> tuple[Tiles, Tiles] | None:
    if max(len(spec_x.mass), len(spec_y.mass)) <= TILED:
        return None
    return both(spectral_tiles, (spec_x,), (spec_y,))
