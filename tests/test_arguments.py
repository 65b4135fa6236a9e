"""What people pass in place of meshes, spectra and landmarks."""

from pathlib import Path

import numpy as np
import pytest

import jfsf
from jfsf import testing
from jfsf.initial._start import given_arrays
from jfsf.matching._arguments import checked_landmarks


@pytest.mark.parametrize("rows", [np.zeros((0, 2), int), np.zeros((0, 2)), []])
def test_no_rows_are_no_landmarks(rows):
    assert checked_landmarks(rows, (9, 9)) is None
    pair = testing.blob_spectrum(0, 45), testing.blob_spectrum(1, 45)
    assert given_arrays(pair, rows, None, None) == (None, None, None)


BALL = testing.blob(0)
TAKE_MESHES = {
    "mesh_x": lambda mesh: jfsf.match(mesh, BALL),
    "mesh_y": lambda mesh: jfsf.match(BALL, mesh, partial=True),
    "template": lambda mesh: jfsf.register(mesh, BALL, [0]),
    "scan": lambda mesh: jfsf.register(BALL, mesh, [0]),
    "mesh_x: ": lambda mesh: jfsf.match_components(mesh, BALL),
    "leg": lambda mesh: jfsf.collection([BALL, mesh], names=["arm", "leg"]),
    "X": lambda mesh: jfsf.apps.transfer.overlay(mesh, BALL, [0]),
    "mesh": lambda mesh: jfsf.basis(mesh),
    **{
        f"mesh: {function.__name__}": function
        for function in (
            *(jfsf.symmetry, jfsf.check, jfsf.mesh.repair, jfsf.mesh.orient),
            *(jfsf.mesh.weld, jfsf.mesh.without_strays, jfsf.mesh.largest_component),
            *(jfsf.mesh.denoised, jfsf.mesh.without_holes, jfsf.mesh.surface_area),
            lambda mesh: jfsf.mesh.decimate(mesh, 9),
            lambda mesh: jfsf.mesh.coarsen(mesh, 9),
        )
    },
}


@pytest.mark.parametrize("name", TAKE_MESHES)
def test_what_is_no_mesh_is_named(name):
    for given, message in (
        ("x.ply", "is a str, 'x.ply', not a mesh; read it with jfsf.read"),
        (Path("x.ply"), r"is a \w+Path, 'x.ply', not a mesh; read it with jfsf.read"),
        (tuple(BALL), r"is a tuple, not a mesh; pass jfsf.Mesh\(vertices, faces\)"),
        (None, r"is a NoneType, not a mesh; pass jfsf.Mesh\(vertices, faces\)"),
    ):
        opens = name.split(":")[0]
        with pytest.raises(jfsf.MeshError, match=f"^{opens}: {message}$"):
            TAKE_MESHES[name](given)


def test_what_is_no_spectrum_is_named():
    spec = testing.blob_spectrum(0, 45)
    with pytest.raises(ValueError, match="spec_y is a Mesh, not a spectrum; pass jfsf"):
        jfsf.match_spectra(spec, BALL)  # type: ignore
    with pytest.raises(ValueError, match=r"specs_x\[1\] is a str, not a spectrum"):
        jfsf.batch.match_spectra([spec, "x.ply"], [spec, spec])  # type: ignore
    with pytest.raises(ValueError, match=r"refine: specs_y\[0\] is a Mesh"):
        jfsf.batch.refine([spec], [BALL], [np.eye(9)], ks=(9, 10))  # type: ignore
