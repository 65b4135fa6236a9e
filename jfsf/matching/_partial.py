"""Meshes of which one is, or both are, a part of a whole. Host side."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jfsf.convert import nearest
from jfsf.matching._arguments import (
    MatchInputs,
    check_one_unit,
    checked_initial,
    checked_landmarks,
)
from jfsf.matching._attempted import Host, match_shapes
from jfsf.matching._confidence import region_confidence
from jfsf.matching._kept_landmarks import landmark_distances
from jfsf.matching._people import places_of_parts
from jfsf.matching._settings import Settings
from jfsf.matching._shapes import MatchedShape, basis_of
from jfsf.matching.parts._match import match_parts
from jfsf.mesh import MeshError
from jfsf.mesh._geometry import boundary_edges, vertex_areas
from jfsf.runtime._runners import OneByOne
from jfsf.spectral import embeddings, functional_map, truncate
from jfsf.types import Match, Mesh


def match_partial(
    meshes: Mapping[str, Mesh],
    inputs: MatchInputs,
    T_yx: Any,
    same_unit: bool,
    settings: Settings,
    host: Host,
) -> Match:
    """`match` with partial=True; T_yx is that of the initial map, if it has one."""
    for name, mesh in meshes.items():
        if len(mesh.faces) == 0:
            raise MeshError(
                "has no faces, and parts are cut out of surfaces",
                "triangulate it",
                name,
            )
    if not any(len(boundary_edges(mesh.faces)) for mesh in meshes.values()):
        shapes = {name: MatchedShape(mesh) for name, mesh in meshes.items()}
        match = match_shapes(shapes, inputs, settings, host)
        ones = (jnp.ones(len(mesh.vertices)) for mesh in meshes.values())
        return _with_region(match, meshes, *ones)

    of_regions = replace(settings, retry_below=0.0)

    if same_unit:
        check_one_unit(*meshes.values())

    def refine(part_x, part_y, T_xy, landmarks=None):
        host.say("refinement of a region")
        sizes = len(part_x.vertices), len(part_y.vertices)
        own = MatchInputs(
            checked_landmarks(landmarks, sizes),
            initial=checked_initial(T_xy, sizes),
            sign=inputs.sign,
        )
        parts = {
            "part of mesh_x": MatchedShape(part_x),
            "part of mesh_y": MatchedShape(part_y),
        }
        # The spectra of cuts on the way are never asked for again.
        quiet = host._replace(keep_spectra=False, progress=None)
        return match_shapes(parts, own, of_regions, quiet)

    host.say("spectra")
    x, y = meshes.values()
    k = min(settings.eigenpairs(len(mesh.vertices)) for mesh in meshes.values())
    spec_x, spec_y = (
        jax.tree.map(
            jnp.asarray,
            truncate(
                basis_of(MatchedShape(mesh), name, settings, host.keep_spectra), k
            ),
        )
        for name, mesh in meshes.items()
    )
    initial = inputs.initial
    if initial is not None and initial.ndim == 2:
        C_yx = jnp.asarray(initial[:k, :k])
        initial = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs)).T_xy
    if T_yx is not None:
        T_yx = checked_initial(T_yx, (len(y.vertices), len(x.vertices)))
    rows = None if inputs.landmarks is None else np.stack(inputs.landmarks, 1)
    runner = OneByOne(host.keep_programs, host.progress)
    places = places_of_parts((spec_x, spec_y), inputs, runner, settings)
    parts = match_parts(
        x,
        y,
        refine,
        inputs.sign,
        T_xy=initial,
        T_yx=T_yx,
        landmarks=rows,
        descriptors=inputs.descriptors,
        places=places,
        same_unit=same_unit,
        settings=settings.parts,
        progress=host.progress,
    )
    T_xy, T_yx, member_x, member_y = map(jnp.asarray, parts[:4])
    C_yx = functional_map(T_xy, spec_x, spec_y)
    certificate = jax.tree.map(jnp.asarray, parts.certificate)
    if inputs.landmarks is not None:
        # Of the whole shapes: one may be outside of the region that was found.
        at_x, at_y = inputs.landmarks
        away = landmark_distances(T_xy[at_x], at_y, spec_y)
        certificate = certificate._replace(landmarks=away.astype(C_yx.dtype))
    if same_unit:  # it was fitted to no others: a small part fits anywhere
        likely = region_confidence(certificate)
        certificate = certificate._replace(confidence=likely)
    match = Match(T_xy, T_yx, C_yx, certificate)
    return _with_region(match, meshes, member_x, member_y)


def _with_region(
    match: Match, meshes: Mapping[str, Mesh], member_x: Array, member_y: Array
) -> Match:
    """The match with what both shapes share, from the membership of each vertex."""
    inside = member_x > 0.5, member_y > 0.5
    shares = []
    for mesh, own in zip(meshes.values(), inside, strict=True):
        areas = vertex_areas(*mesh)  # in any unit: float32 has none for some
        share = areas[np.asarray(own)].sum() / areas.sum()
        shares.append(jnp.asarray(share, member_x.dtype))
    share_x, share_y = shares
    return match._replace(
        matched_x=inside[0],
        matched_y=inside[1],
        membership_x=member_x,
        membership_y=member_y,
        overlap_x=share_x,
        overlap_y=share_y,
    )
