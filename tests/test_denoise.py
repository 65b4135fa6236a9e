"""Noise and spikes: measured as they were made, taken away, and absent where clean."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import frozen

from jfsf import data, testing
from jfsf.mesh import denoised, surface_area
from jfsf.mesh._denoise import noise, spikes, without_spikes
from jfsf.mesh._geometry import face_normals
from jfsf.types import Mesh

MAN = data.load("man_walk").mesh
ROOT = np.sqrt(surface_area(MAN))
CLEAN = [*data.names(), "blob", "sphere", "plane"]


def clean(name):
    if name == "blob":
        return testing.blob(1, subdivisions=4)
    if name == "sphere":
        vertices, faces = testing.blob(0, subdivisions=3)
        return Mesh(vertices / np.linalg.norm(vertices, axis=1)[:, None], faces)
    if name == "plane":
        x, y = np.mgrid[:20, :20]
        i = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
        faces = np.concatenate([[i, i + 20, i + 1], [i + 1, i + 20, i + 21]], 1).T
        return Mesh(np.stack([x, y, 0 * x], 2).reshape(-1, 3) / 3, faces)
    return data.load(name).mesh


def noisy(mesh, size, seed=0):
    step = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return Mesh(mesh.vertices + size * step, mesh.faces)


def spiky(mesh, number, seed=0):
    rng = np.random.default_rng(seed)
    at = rng.choice(len(mesh.vertices), number, replace=False)
    away = rng.normal(size=(number, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    vertices = mesh.vertices.copy()
    vertices[at] += away * np.sqrt(surface_area(mesh)) / 2
    return Mesh(vertices, mesh.faces), np.sort(at)


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_mesh_is_left_alone(name):
    mesh = clean(name)
    assert denoised(mesh) is mesh and without_spikes(mesh) is mesh
    assert noise(mesh) == 0 and not spikes(mesh).any()


@pytest.mark.parametrize("name", ["man_walk", "child_kick", "blob"])
@pytest.mark.parametrize("share", [0.3, 0.6, 1.2])
def test_noise_is_measured(name, share):
    mesh = clean(name)
    size = share * np.sqrt(surface_area(mesh) / len(mesh.vertices))
    assert np.isclose(noise(noisy(mesh, size)), size, rtol=0.1)


@pytest.mark.parametrize("size", [0.005, 0.01, 0.02])
def test_noise_is_taken_away(size):
    mesh = frozen(noisy(MAN, size * ROOT))
    found = denoised(mesh)
    assert found.faces is mesh.faces
    before, after = (
        np.sqrt(((m.vertices - MAN.vertices) ** 2).mean()) for m in (mesh, found)
    )
    assert after < 0.5 * before
    # The faces look where they did.
    normal, wrong, right = (face_normals(*m) for m in (MAN, mesh, found))
    agree = lambda one: np.mean((one * normal).sum(1) > 0)
    assert agree(right) > agree(wrong) and agree(right) > 0.9
    assert abs(surface_area(found) / ROOT**2 - 1) < 0.5 * abs(
        surface_area(mesh) / ROOT**2 - 1
    )


@given(st.integers(1, 60), testing.seeds)
def test_spikes_are_found_and_flattened(number, seed):
    mesh, at = spiky(MAN, number, seed)
    seen = np.flatnonzero(spikes(frozen(mesh)))
    assert set(seen) <= set(at)
    # Neighbouring spikes hide each other at first.
    assert len(seen) >= 0.9 * number - 2
    flat = without_spikes(mesh)
    assert not spikes(flat).any()
    moved = (flat.vertices != mesh.vertices).any(1)
    assert not moved[np.setdiff1d(np.arange(len(moved)), at)].any()
    away = np.linalg.norm(flat.vertices - MAN.vertices, axis=1)
    assert np.median(away[at]) < 0.01 * ROOT and away.max() < 0.2 * ROOT


def test_spikes_are_no_noise():
    mesh, at = spiky(MAN, 20)
    found = denoised(mesh)
    moved = (found.vertices != mesh.vertices).any(1)
    assert set(np.flatnonzero(moved)) <= set(at)


@given(testing.seeds, st.floats(1e-6, 1e6))
def test_units_place_and_order_do_not_matter(seed, unit):
    mesh = noisy(spiky(clean("child_t"), 5, seed)[0], 0.01, seed)
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    order = rng.permutation(len(mesh.vertices))
    rank = np.argsort(order)
    faces = rank[mesh.faces][rng.permutation(len(mesh.faces))]
    other = Mesh(unit * mesh.vertices[order] @ turn, faces)
    assert np.array_equal(spikes(other), spikes(mesh)[order])
    assert np.isclose(noise(other), unit * noise(mesh), rtol=1e-6)


def test_smoothing_moves_with_the_mesh():
    mesh = noisy(MAN, 0.01 * ROOT)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = Mesh(1000 * mesh.vertices @ turn + 5, mesh.faces)
    expected = 1000 * denoised(mesh).vertices @ turn + 5
    away = np.abs(denoised(moved).vertices - expected).max()
    assert away < 0.002 * 1000 * ROOT


def test_a_cloud_has_neither():
    cloud = Mesh(MAN.vertices, MAN.faces[:0])
    assert denoised(cloud) is cloud and noise(cloud) == 0
    assert spikes(cloud).shape == (len(cloud.vertices),) and not spikes(cloud).any()


def test_stray_vertices_stay():
    mesh = noisy(MAN, 0.01 * ROOT)
    more = Mesh(np.concatenate([mesh.vertices, [[9.0, 9, 9]]]), mesh.faces)
    found = denoised(more)
    assert np.allclose(found.vertices[-1], 9)
    assert not spikes(more)[-1] and np.isclose(noise(more), noise(mesh))
