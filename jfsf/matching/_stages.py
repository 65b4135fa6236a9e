"""The stages of an attempt that `Settings` can replace, and what they do by default.

| field of `Settings` | from | to | by default |
|---|---|---|---|
| `describe` | the spectrum of a shape | its `Features` | `jfsf.spectral.features` |
| `refine` | the features of both, C_yx | C_yx, refined | `refine_by_zoomout` |
| `deform` | the spectra of both, C_yx | `Aligned` embeddings | `deform_by_arap` |

Each may be any function with these arguments, made of jax operations. The last one of
an attempt, `Settings.converter`, is a `jfsf.convert.Converter`. `pair_search` says how
neighbours are searched between two shapes; converters and `deform` are handed it.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jfsf.convert import nearest
from jfsf.neighbours import NeighbourSearch
from jfsf.neighbours._tiles import tiles_of_pair
from jfsf.refine import arap, zoomout
from jfsf.spectral import Features, embeddings, uniform
from jfsf.types import Aligned, Bent, Spectrum

Describe = Callable[..., Features]
"""(spec, descriptors, landmarks, *, self_map, settings: FeatureSettings) -> `Features`.

As `jfsf.spectral.features`, which explains what features are. The descriptors of
landmarks come last, `LANDMARK_TIMES` of them for each landmark: those
of landmarks that a map misses are left out of its refinement.
"""
Refine = Callable[..., Float[Array, "k l"]]
"""(x, y, C_yx, orientation, descriptor_weight, *, settings) -> C_yx, refined.

As `refine_by_zoomout`.
"""
Deform = Callable[..., Aligned]
"""(spec_x, spec_y, C_yx, orientation, search, *, settings) -> `Aligned` embeddings.

As `deform_by_arap`. A function of your own is handed the functional map of the whole
shapes, however large they are. If it returns `moved_x` and `moved_y`, the confidence
reads how well they coincide.
"""
# Recall among tiles below which the last conversion compares all points. Rounds of the
# refinement and the bending do not check it: later ones correct what is missed.
MIN_RECALL = 0.95


def refine_by_zoomout(
    x: Features,
    y: Features,
    C_yx: Float[Array, "k_x k_y"],
    orientation: Float[Array, ""] | float = 1.0,
    descriptor_weight: Float[Array, ""] | float = 0.5,
    *,
    settings: Any,
) -> Float[Array, "k k"]:
    """ZoomOut of C_yx with descriptors, curvature and oriented products.

    Args:
        x, y: features, whole or at samples.
        C_yx: the start; its leading block of `ks[0]` functions, if it has more.
        orientation: 1 or -1, the sign of the start's orientation; 0 if unknown.
        descriptor_weight: weight of descriptors, curvature and oriented products
            relative to the eigenfunctions. Where proportions differ, descriptors do
            too: there a tenth is better.
        settings: `jfsf.Settings`: `ks`, `refine_converter`. Sizes beyond the
            eigenpairs there are are cut; a smaller start adds its own size in front.
    """
    widest = min(len(x.spec.evals), len(y.spec.evals))
    ks = tuple(min(k, widest) for k in settings.ks)
    if (size := min(C_yx.shape)) < ks[0]:
        ks = (size, *ks)
    return zoomout(
        x.spec,
        y.spec,
        C_yx,
        x.columns,
        y.columns,
        orientation * x.bracket_fields,
        y.bracket_fields,
        ks=ks,
        converter=settings.refine_converter,
        weighted=True,
        bidirectional=True,
        extra_weight=descriptor_weight,
        search=pair_search(x.spec, y.spec, settings=settings).unchecked(),
    )


def deform_by_arap(
    spec_x: Spectrum,
    spec_y: Spectrum,
    C_yx: Float[Array, "k_x k_y"] | Bent,
    orientation: Float[Array, ""] | float = 1.0,
    search: NeighbourSearch | None = None,
    *,
    settings: Any,
) -> Aligned:
    """Both shapes bent onto each other as rigidly as possible (`jfsf.refine.arap`).

    Args:
        spec_x, spec_y: with their vertices and faces.
        C_yx: the refined functional map, whose rows of zeros are left out; or, for the
            last rounds, shapes with faces that are already deformed.
        orientation: -1 for a map that mirrors.
        search: how neighbours are searched.
        settings: `jfsf.Settings`: `bend_rounds`, `last_rounds`, `bend`. Without rounds,
            or if neither shape has faces, the embeddings are those of C_yx, in the
            direct space.
    """
    search = (search or NeighbourSearch()).unchecked()
    options = {"converter": nearest, "search": search, "settings": settings.bend}
    sign = jnp.where(jnp.asarray(orientation) < 0, -1.0, 1.0)
    if isinstance(C_yx, Bent):
        bent = arap(spec_x, spec_y, C_yx, sign, rounds=settings.last_rounds, **options)
        return _aligned(bent)
    emb_x, emb_y = embeddings(C_yx, spec_x.evecs, spec_y.evecs, space="direct")
    emb_x = jnp.asarray(jnp.where(jnp.any(C_yx != 0, 1)[None], emb_x, 0))
    if settings.bend_rounds == 0 or not len(spec_x.faces) + len(spec_y.faces):
        return Aligned(emb_x, emb_y)
    # A cloud without a surface beside a mesh gets a face of padding: its points move
    # freely, while the mesh resists.
    spec_x, spec_y = (
        spec if len(spec.faces) else spec._replace(faces=jnp.zeros((1, 3), jnp.int32))
        for spec in (spec_x, spec_y)
    )
    marginals = uniform(spec_x.mass), uniform(spec_y.mass)
    maps = nearest(emb_x, emb_y, *marginals, search)
    return _aligned(
        arap(spec_x, spec_y, maps, sign, rounds=settings.bend_rounds, **options)
    )


def _aligned(embs: tuple[Float[Array, "n_x 12"], Float[Array, "n_y 12"]]) -> Aligned:
    emb_x, emb_y = embs
    return Aligned(emb_x, emb_y, emb_x[:, :3], emb_y[:, 3:6])


def pair_search(
    spec_x: Spectrum, spec_y: Spectrum, *, settings: Any
) -> NeighbourSearch:
    """How neighbours are searched between two shapes of these sizes.

    Args:
        spec_x, spec_y: whole or at samples.
        settings: `jfsf.Settings`: among tiles above `tiles_above` vertices; all points
            are compared where the recall is below `MIN_RECALL`, but never above
            `exhaustive_up_to` vertices.
    """
    larger = max(len(spec_x.mass), len(spec_y.mass))
    return NeighbourSearch(
        tiles_of_pair(spec_x, spec_y) if larger > settings.tiles_above else None,
        # To compare a million points with all others would take hours.
        0.0 if larger > settings.exhaustive_up_to else MIN_RECALL,
        settings.neighbours,
    )
