"""decimate: fewer vertices, the same closed surface."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

import jfsf
from jfsf.data import load
from jfsf.matching.parts import cut
from jfsf.mesh import check, coarsen, decimate, surface_area
from jfsf.types import Mesh

MESH = load("man_up").mesh


@pytest.mark.parametrize("num", [300, 1000, 4000])
def test_a_closed_surface_stays_one(num):
    small = decimate(MESH, num)
    assert 0.9 * num < len(small.vertices) < 1.02 * num
    report = check(small)
    assert report.components == 1 and report.boundary_edges == 0
    assert len(small.vertices) - len(small.faces) / 2 == 2
    assert abs(surface_area(small) / surface_area(MESH) - 1) < 0.1
    assert KDTree(small.vertices).query(MESH.vertices)[0].max() < 0.2


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_units_and_place_change_little(unit):
    moved = Mesh((MESH.vertices + 1000) * unit, MESH.faces)
    small, plain = decimate(moved, 800), decimate(MESH, 800)
    assert abs(len(small.vertices) - len(plain.vertices)) < 20
    back = small.vertices / unit - 1000
    assert KDTree(MESH.vertices).query(back)[0].max() < 0.05


def test_close_sheets_stay_apart():
    box = trimesh.creation.box((1, 1, 0.01)).subdivide().subdivide().subdivide()
    sheets = Mesh(np.asarray(box.vertices), np.asarray(box.faces, np.int32))
    small = decimate(sheets, 100)
    assert check(small).nonmanifold_edges == 0
    assert abs(surface_area(small) / surface_area(sheets) - 1) < 0.01
    assert np.ptp(coarsen(sheets, 100).mesh.vertices[:, 2]) < 0.02  # for contrast


@pytest.mark.parametrize("num", [600, 1000, 1200])
def test_an_arm_that_hangs_on_by_a_vertex_is_kept(num):
    body = load("man_t").mesh
    across = body.vertices[:, 0] - body.vertices[:, 0].mean()
    ring = np.flatnonzero(np.abs(across / across.max() - 0.4) < 0.02)
    parts, number = [], np.arange(len(across))
    for vertex in ring:  # the only one of them that is left
        kept = ~np.isin(number, ring) | (number == vertex)
        part = cut(body, kept).mesh
        if surface_area(part) > 0.97 * surface_area(body):
            parts.append(part)
    assert parts
    for part in parts:
        fewer = decimate(part, num)
        assert check(part).components == check(fewer).components == 1
        assert len(np.unique(fewer.faces)) == len(fewer.vertices)
        assert surface_area(fewer) == pytest.approx(surface_area(part), rel=0.02)
        gap = KDTree(fewer.vertices).query(part.vertices)[0].max()
        assert gap < 0.12 * np.sqrt(surface_area(part))


def test_of_several_pieces_the_largest_is_kept():
    other = MESH._replace(vertices=0.5 * MESH.vertices + 10)
    both = Mesh(
        np.concatenate([other.vertices, MESH.vertices]),
        np.concatenate([other.faces, MESH.faces + len(other.vertices)]),
    )
    small = decimate(both, 1000)
    assert check(small).components == 1 and small.vertices.max() < 5
    assert len(decimate(both, len(MESH.vertices) + 100).vertices) == len(MESH.vertices)


def test_small_meshes_come_back_whole():
    assert decimate(MESH, len(MESH.vertices)) is MESH


@pytest.mark.parametrize("mesh", [MESH, MESH._replace(faces=MESH.faces[:0])])
def test_errors(mesh):
    with pytest.raises(ValueError, match="decimate: num is 3 and the mesh has"):
        decimate(mesh, 3)


def test_what_is_left_of_a_scan_can_be_matched():
    jfsf.check_matchable(decimate(MESH, 500))


def test_vertices_without_a_face_do_not_count():
    strays = Mesh(np.concatenate([MESH.vertices, np.zeros((9000, 3))]), MESH.faces)
    assert len(decimate(strays, 1000).vertices) == len(decimate(MESH, 1000).vertices)
