"""pyFM's meshes and maps: directions, areas and signs, against pyFM's own numbers."""

import sys

import jax
import numpy as np
import pytest
import scipy.sparse as sp
from pyFM.functional import FunctionalMapping
from pyFM.mesh import TriMesh
from pyFM.spectral import mesh_p2p_to_FM

from jfsf import testing
from jfsf.apps.interop import (
    from_pyfm,
    spectrum_from_pyfm,
    spectrum_to_pyfm,
    to_pyfm,
)
from jfsf.convert import nearest
from jfsf.spectral import embeddings, functional_map, spectrum
from jfsf.types import Mesh

MESH_X, MESH_Y = testing.blob(1, subdivisions=3), testing.blob(1, subdivisions=2)
N_X, N_Y, K_X, K_Y = 642, 162, 12, 9
T_XY = np.random.default_rng(0).integers(0, N_Y, N_X).astype(np.int32)
CLOUD = Mesh(MESH_Y.vertices, np.zeros((0, 3), np.int32))


@pytest.fixture(scope="module")
def spectra():
    pair = spectrum(MESH_X, K_X, cache=False), spectrum(MESH_Y, K_Y, cache=False)
    return jax.tree.map(np.asarray, pair)


def in_units(mesh, unit, k, sign=1):
    """pyFM's mesh and eigenpairs in another unit, the constant of the given sign."""
    found = TriMesh(mesh.vertices * unit + 3, mesh.faces).process(k)
    evecs = np.array(found.eigenvectors)
    evecs[:, 0] *= sign * np.sign(evecs[:, 0].mean())
    found.eigenvectors = evecs
    return found


def test_a_map_is_pyfms_with_x_2_and_y_1(spectra):
    mesh2, mesh1 = map(spectrum_to_pyfm, spectra)
    C_yx = functional_map(T_XY, *spectra)
    found = to_pyfm(mesh1=mesh1, mesh2=mesh2, T_xy=T_XY, C_yx=C_yx)
    assert found.FM_12.shape == (K_X, K_Y)
    np.testing.assert_array_equal(found.p2p_21, T_XY)
    theirs = mesh_p2p_to_FM(found.p2p_21, mesh1, mesh2)
    np.testing.assert_allclose(found.FM_12, theirs, atol=1e-10)
    back = from_pyfm(mesh1=mesh1, mesh2=mesh2, **found._asdict())
    np.testing.assert_array_equal(back.T_xy, T_XY)
    np.testing.assert_allclose(back.C_yx, C_yx, atol=1e-12)
    assert back.T_xy.dtype == np.int32


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1)])
def test_functional_maps_of_any_units_and_signs(signs):
    mesh2 = in_units(MESH_X, 3.0, K_X, signs[0])
    mesh1 = in_units(MESH_Y, 0.2, K_Y, signs[1])
    FM_12 = mesh_p2p_to_FM(T_XY, mesh1, mesh2)
    C_yx = functional_map(T_XY, spectrum_from_pyfm(mesh2), spectrum_from_pyfm(mesh1))
    assert abs(FM_12 - C_yx).max() > 0.5
    found = from_pyfm(mesh1=mesh1, mesh2=mesh2, FM_12=FM_12)
    assert found.T_xy is None
    np.testing.assert_allclose(found.C_yx, C_yx, atol=1e-10)
    back = to_pyfm(mesh1=mesh1, mesh2=mesh2, C_yx=np.asarray(C_yx)[:7, :5])
    np.testing.assert_allclose(back.FM_12, FM_12[:7, :5], atol=1e-10)


def test_a_spectrum_of_pyfm_is_ours_at_area_1():
    # pyFM's areas are thirds of triangles.
    ours = spectrum(MESH_X, K_X, mass="barycentric", tol=1e-9, cache=False)
    theirs = spectrum_from_pyfm(in_units(MESH_X, 50.0, K_X, -1))
    np.testing.assert_allclose(theirs.evals, ours.evals, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(theirs.mass, ours.mass, atol=1e-12)
    np.testing.assert_allclose(theirs.vertices, ours.vertices, atol=1e-12)
    np.testing.assert_allclose(theirs.evecs[:, 0], 1, atol=1e-6)
    signs = np.sign((ours.evecs * theirs.evecs).sum(0))
    np.testing.assert_allclose(theirs.evecs * signs, ours.evecs, atol=1e-4)
    assert theirs.faces.dtype == np.int32


def test_spectra_there_and_back(spectra):
    for spec in spectra:
        shape = spectrum_to_pyfm(spec)
        assert shape.area == pytest.approx(1)
        for ours, back in zip(spec, spectrum_from_pyfm(shape), strict=True):
            np.testing.assert_allclose(back, ours, atol=1e-12)
            assert back.dtype == ours.dtype
        # The same operator: W evecs = A evecs evals.
        gap = shape.W @ shape.eigenvectors - shape.A @ shape.eigenvectors * spec.evals
        assert np.abs(gap).max() < 1e-2 * spec.mass.max() * spec.evals.max()


def test_pyfm_goes_on_with_our_map(spectra):
    spec_x, spec_y = spectra
    mesh2, mesh1 = map(spectrum_to_pyfm, spectra)
    C_yx = np.asarray(functional_map(T_XY, *spectra))
    model = FunctionalMapping(mesh1, mesh2)
    model.FM_12 = to_pyfm(mesh1=mesh1, mesh2=mesh2, C_yx=C_yx).FM_12
    ours = nearest(*embeddings(C_yx, spec_x.evecs, spec_y.evecs))
    np.testing.assert_array_equal(model.get_p2p(use_adj=True), ours.T_xy)
    model.FM_12 = model.FM_12[:6, :5]
    assert model.zoomout_refine(nit=2).shape == (8, 7)


def test_point_clouds_have_spectra_too():
    cloud = TriMesh(CLOUD.vertices).process(K_Y)
    spec = spectrum_from_pyfm(cloud)
    assert spec.faces.shape == (0, 3)
    np.testing.assert_allclose(spec.mass.sum(), 1)
    back = spectrum_to_pyfm(spec)
    evals = cloud.eigenvalues * cloud.area
    np.testing.assert_allclose(back.eigenvalues, evals, atol=1e-9)


def test_the_other_direction_is_refused(spectra):
    mesh2, mesh1 = map(spectrum_to_pyfm, spectra)
    pair = {"mesh1": mesh1, "mesh2": mesh2}
    T_yx = np.zeros(N_Y, int)
    with pytest.raises(
        ValueError, match="T_xy has shape .162.*642.*runs the other way"
    ):
        to_pyfm(**pair, T_xy=T_yx)
    with pytest.raises(ValueError, match="p2p_21 has shape .162"):
        from_pyfm(**pair, p2p_21=T_yx)
    with pytest.raises(ValueError, match="from 0 to 162, .* vertices 0 to 161"):
        from_pyfm(**pair, p2p_21=np.arange(N_X) % 163)
    with pytest.raises(ValueError, match="holds float64, expected vertex numbers"):
        to_pyfm(**pair, T_xy=T_XY + 0.5)
    C_xy = np.zeros((K_Y, K_X))
    with pytest.raises(
        ValueError, match="12 eigenvectors .rows. and Y has 9 .columns."
    ):
        to_pyfm(**pair, C_yx=C_xy)
    with pytest.raises(ValueError, match=r"\(9, 12\).*the other way"):
        from_pyfm(**pair, FM_12=C_xy)


def test_our_meshes_are_not_pyfms(spectra):
    with pytest.raises(ValueError, match="to_pyfm: a mesh is Mesh, expected pyFM's"):
        to_pyfm(mesh1=MESH_Y, mesh2=spectrum_to_pyfm(spectra[0]), T_xy=T_XY)


def test_what_is_no_spectrum_is_refused(spectra):
    raw = TriMesh(*MESH_Y)
    with pytest.raises(ValueError, match=r"call mesh.process\(k\)"):
        spectrum_from_pyfm(raw)
    with pytest.raises(ValueError, match="to_pyfm: the mesh has no eigenvectors"):
        to_pyfm(mesh1=raw, mesh2=spectrum_to_pyfm(spectra[0]), C_yx=np.eye(3))
    broken = spectrum_to_pyfm(spectra[1])
    broken.mass = sp.csr_matrix(np.full((N_Y, N_Y), 1 / N_Y**2))
    with pytest.raises(ValueError, match="not diagonal"):
        spectrum_from_pyfm(broken)
    broken = spectrum_to_pyfm(spectra[1])
    broken.mass = broken.mass * 4
    with pytest.raises(ValueError, match=r"not orthonormal for these areas \(off by 3"):
        spectrum_from_pyfm(broken)
    broken = spectrum_to_pyfm(spectra[1])
    broken.eigenvalues = broken.eigenvalues[::-1]
    with pytest.raises(ValueError, match="not ascending"):
        spectrum_from_pyfm(broken)
    broken = spectrum_to_pyfm(spectra[1])
    broken.eigenvalues, broken.eigenvectors = (
        broken.eigenvalues[1:],
        broken.eigenvectors[:, 1:],
    )
    with pytest.raises(ValueError, match="first eigenvector is not constant"):
        spectrum_from_pyfm(broken)
    broken.eigenvalues = broken.eigenvalues[1:]
    with pytest.raises(ValueError, match=r"evecs \(162, 8\), evals \(7,\)"):
        spectrum_from_pyfm(broken)
    broken = spectrum_to_pyfm(spectra[1])
    broken.eigenvectors = broken.eigenvectors * np.nan
    with pytest.raises(ValueError, match="must be finite"):
        spectrum_from_pyfm(broken)
    mass = np.append(spectra[1].mass[:-1], 0)
    with pytest.raises(ValueError, match="1 of 162 vertices are padding"):
        spectrum_to_pyfm(spectra[1]._replace(mass=mass))


def test_a_missing_package_says_how_to_install(monkeypatch, spectra):
    monkeypatch.setitem(sys.modules, "pyFM.mesh", None)
    with pytest.raises(
        ImportError, match=r"needs pyfmaps.*pip install 'jfsf\[interop\]'"
    ):
        spectrum_to_pyfm(spectra[1])
