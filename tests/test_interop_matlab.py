"""MATLAB's structs: what is written is a shape of those codes, and reads back."""

import jax
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from jfsf import testing
from jfsf.apps.interop import from_matlab, read_matlab, to_matlab, write_matlab
from jfsf.apps.mapfiles import MapFileError, read_map
from jfsf.mesh import surface_area
from jfsf.spectral import functional_map, spectrum
from jfsf.types import Mesh

N_X, N_Y, K_X, K_Y = 642, 162, 12, 9
T_XY = np.random.default_rng(0).integers(0, N_Y, N_X).astype(np.int32)


@pytest.fixture(scope="module")
def shapes():
    """Two meshes in different units with their spectra."""
    found = []
    for unit, level, k in ((100.0, 3, K_X), (0.3, 2, K_Y)):
        mesh = testing.blob(1, subdivisions=level)
        mesh = mesh._replace(vertices=mesh.vertices * unit + unit)
        found.append((mesh, jax.tree.map(np.asarray, spectrum(mesh, k, cache=False))))
    return found


@pytest.fixture(scope="module")
def paths(shapes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("mat")
    for name, (mesh, spec) in zip("xy", shapes, strict=True):
        write_matlab(folder / f"{name}.mat", mesh, spec)
    assert {p.name for p in folder.iterdir()} == {"x.mat", "y.mat"}
    return folder / "x.mat", folder / "y.mat"


def loaded(path):
    """The struct that `S = load(path)` gives in MATLAB."""
    return scipy.io.loadmat(path, simplify_cells=True)


def spectrum_in(path, **key):
    found = read_matlab(path, **key).spectrum
    assert found is not None
    return found


def test_the_file_is_the_struct_of_those_codes(shapes, paths):
    for path, (mesh, spec) in zip(paths, shapes, strict=True):
        S = loaded(path)
        surface = S["surface"]
        np.testing.assert_array_equal(surface["TRIV"], mesh.faces + 1)
        assert surface["TRIV"].dtype == float and surface["TRIV"].min() == 1
        np.testing.assert_array_equal(surface["VERT"], mesh.vertices)
        for axis, values in zip("XYZ", mesh.vertices.T, strict=True):
            np.testing.assert_array_equal(surface[axis], values)
        assert scipy.io.loadmat(path)["surface"][0, 0]["X"].shape == (len(values), 1)
        assert (S["nv"], S["nf"]) == (len(mesh.vertices), len(mesh.faces))
        assert S["area"] == pytest.approx(surface_area(mesh))
        assert S["sqrt_area"] ** 2 == pytest.approx(S["A"].sum())
        # Eigenpairs of this W and A, in the unit of the mesh.
        evecs, evals = S["evecs"], S["evals"]
        k = len(evals)
        assert evals.shape == spec.evals.shape and sp.issparse(S["A"])
        gram = evecs.T @ (S["A"] @ evecs)
        np.testing.assert_allclose(gram, np.eye(k), atol=1e-8)
        rayleigh = evecs.T @ (S["W"] @ evecs)
        np.testing.assert_allclose(rayleigh, np.diag(evals), atol=1e-3 * evals.max())


def test_shapes_there_and_back(shapes, paths):
    for path, (mesh, spec) in zip(paths, shapes, strict=True):
        found = read_matlab(path)
        for ours, back in zip(mesh, found.mesh, strict=True):
            np.testing.assert_array_equal(back, ours)
            assert back.dtype == ours.dtype
        for ours, back in zip(spec, found.spectrum, strict=True):
            np.testing.assert_allclose(back, ours, atol=1e-9)
            assert back.dtype == ours.dtype


def test_maps_are_those_of_the_files_bases(shapes, paths, tmp_path):
    (_, spec_x), (_, spec_y) = shapes
    pair = {"shape_x": read_matlab(paths[0]), "shape_y": read_matlab(paths[1])}
    C_yx = np.asarray(functional_map(T_XY, spec_x, spec_y))
    found = to_matlab(**pair, T_xy=T_XY, C_yx=C_yx)
    S1, S2 = map(loaded, paths)
    # C21 = S1.evecs \ S2.evecs(T12, :), by the areas.
    T12 = found.T12[:, 0].astype(int)
    C21 = S1["evecs"].T @ (S1["A"] @ S2["evecs"][T12 - 1])
    np.testing.assert_allclose(found.C21, C21, atol=1e-8 * np.abs(C21).max())
    assert np.abs(C21[0, 0]) > 100
    back = from_matlab(**pair, **found._asdict())
    np.testing.assert_array_equal(back.T_xy, T_XY)
    np.testing.assert_allclose(back.C_yx, C_yx, atol=1e-10)
    scipy.io.savemat(tmp_path / "T12.mat", {"T12": found.T12})
    np.testing.assert_array_equal(read_map(tmp_path / "T12.mat", n_to=N_Y), T_XY)


def test_maps_that_do_not_fit_are_refused(shapes, paths):
    shape_x, shape_y = map(read_matlab, paths)
    pair = {"shape_x": shape_x, "shape_y": shape_y}
    with pytest.raises(ValueError, match="T12 has shape .162.*642.*the other way"):
        from_matlab(**pair, T12=np.ones((N_Y, 1)))
    with pytest.raises(ValueError, match="T12 runs from 0 .* vertices 1 to 162"):
        from_matlab(**pair, T12=T_XY)
    with pytest.raises(ValueError, match="T_xy has shape"):
        to_matlab(**pair, T_xy=np.zeros(N_Y, int))
    with pytest.raises(ValueError, match=r"\(9, 12\), but X has 12"):
        from_matlab(**pair, C21=np.zeros((K_Y, K_X)))
    bare = shape_x._replace(spectrum=None, factors=None)
    with pytest.raises(ValueError, match="no eigenvectors"):
        to_matlab(shape_x=bare, shape_y=shape_y, C_yx=np.eye(3))


def variants(S):
    """The same shape as other codes save it."""
    surface = S["surface"]
    flat = {name: surface[name] for name in ("VERT", "TRIV")}
    spectral = {name: S[name] for name in ("evecs", "evals", "A")}
    column = {name: surface[name][:, None] for name in "XYZ"}
    column["TRIV"] = surface["TRIV"].astype(np.int32)
    return {
        "struct": {"shape": {"surface": column} | spectral},
        "M.VERT": {"M": flat | spectral, "other": np.eye(2)},
        "variables": flat | spectral | {"A": S["A"].diagonal()},
        "dense": {"surface": flat} | spectral | {"A": S["A"].toarray()},
        "diagonal evals": {"surface": flat} | spectral | {"evals": np.diag(S["evals"])},
        "area a vector": {"surface": flat} | spectral | {"area": S["A"].diagonal()},
    }


@pytest.mark.parametrize("which", range(6))
def test_structs_of_other_codes(paths, tmp_path, which):
    wanted = read_matlab(paths[1])
    name, content = list(variants(loaded(paths[1])).items())[which]
    scipy.io.savemat(tmp_path / "s.mat", content)
    found = read_matlab(tmp_path / "s.mat")
    for ours, back in zip(jax.tree.leaves(wanted), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(back, ours, atol=1e-12, err_msg=name)


def test_a_negative_constant_is_turned_and_maps_with_it(paths, tmp_path):
    S = loaded(paths[1])
    S["evecs"][:, 0] *= -1
    scipy.io.savemat(
        tmp_path / "s.mat", {n: S[n] for n in ("surface", "evecs", "evals", "A")}
    )
    found = spectrum_in(tmp_path / "s.mat")
    np.testing.assert_allclose(found.evecs[:, 0], 1)
    C_yx = functional_map(T_XY, spectrum_in(paths[0]), found)
    pair = {"shape_x": read_matlab(paths[0])}
    pair["shape_y"] = read_matlab(tmp_path / "s.mat")
    C21 = to_matlab(**pair, C_yx=C_yx).C21
    assert C21[0, 0] < 0
    np.testing.assert_allclose(from_matlab(**pair, C21=C21).C_yx, C_yx, atol=1e-12)


def test_key_names_one_of_several_shapes(shapes, tmp_path):
    (mesh, spec), (other, _) = shapes
    write_matlab(tmp_path / "one.mat", mesh, spec, key="S1")
    found = spectrum_in(tmp_path / "one.mat", key="S1")
    np.testing.assert_allclose(found.evals, spec.evals, atol=1e-9)
    np.testing.assert_array_equal(spectrum_in(tmp_path / "one.mat").mass, found.mass)
    both = {name: {"TRIV": m.faces + 1, "VERT": m.vertices} for name, m in
            (("S1", mesh), ("S2", other))}  # fmt: skip
    scipy.io.savemat(tmp_path / "two.mat", both)
    found = read_matlab(tmp_path / "two.mat", key="S2")
    np.testing.assert_array_equal(found.mesh.faces, other.faces)
    assert found.spectrum is None and found.factors is None
    with pytest.raises(MapFileError, match="two.mat: .*pass one of S1, S2 as `key`"):
        read_matlab(tmp_path / "two.mat")
    with pytest.raises(MapFileError, match="a shape 'S3', but S1, S2"):
        read_matlab(tmp_path / "two.mat", key="S3")


def test_point_clouds_and_meshes_without_a_spectrum(shapes, tmp_path):
    mesh, _ = shapes[1]
    cloud = Mesh(mesh.vertices, np.zeros((0, 3), np.int32))
    for shape in (mesh, cloud):
        write_matlab(tmp_path / "s.mat", shape)
        assert set(loaded(tmp_path / "s.mat")["surface"]) == set("XYZ") | {
            "VERT",
            "TRIV",
        }
        found = read_matlab(tmp_path / "s.mat")
        np.testing.assert_array_equal(found.mesh.faces, shape.faces)
        assert found.spectrum is None
    spec = spectrum(cloud, K_Y, cache=False)
    write_matlab(tmp_path / "c.mat", cloud, spec)
    back = spectrum_in(tmp_path / "c.mat")
    np.testing.assert_allclose(back.evals, spec.evals, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"TRIV": [[0, 1, 2]]}, "TRIV runs from 0 to 2; .* from 1 to 162"),
        ({"TRIV": [[1, 2, 163]]}, "TRIV runs from 1 to 163"),
        ({"TRIV": [[1, 2, 2.5]]}, "whole numbers"),
        ({"TRIV": [[1, 2, np.nan]]}, "whole numbers"),
        ({"TRIV": [[1, 2, 3, 4]]}, r"faces are int32 \(1, 4\)"),
        ({"TRIV": "abc"}, "TRIV is no matrix of real numbers"),
        ({"VERT": sp.eye(162, 3)}, "VERT is sparse; save full"),
        ({"TRIV": None}, "does not hold one surface"),
        ({"VERT": np.full((162, 3), np.inf)}, "not finite"),
        ({"VERT": np.zeros((162, 2))}, r"pass \(n, 3\)"),
        ({"VERT": None, "X": [1, 2], "Y": [1], "Z": [1]}, "X, Y, Z have 2, 1, 1"),
        ({"VERT": None, "X": [1, 2], "Y": [1, 2]}, "lacks Z; it holds"),
        ({"evals": None}, "lacks evals"),
        ({"A": None}, "lacks A"),
        ({"A": np.ones((162, 162))}, r"A \(162, 162\) is not diagonal"),
        ({"A": np.eye(162)}, "not orthonormal"),
        ({"A": np.ones(161)}, r"areas \(161,\)"),
        ({"A": sp.eye(162, 9)}, r"A \(162, 9\) is not diagonal"),
        ({"evals": np.ones(9) * 1j}, "evals is no matrix of real numbers"),
    ],
)
def test_what_is_no_shape_is_refused(paths, tmp_path, change, message):
    S = variants(loaded(paths[1]))["variables"] | change
    path = tmp_path / "s.mat"
    scipy.io.savemat(path, {name: v for name, v in S.items() if v is not None})
    with pytest.raises(ValueError, match=message) as caught:
        read_matlab(path)
    assert str(caught.value).startswith(str(path))


def test_what_does_not_fit_is_not_written(shapes, tmp_path):
    (mesh, spec), (other, _) = shapes
    with pytest.raises(MapFileError, match="give it that suffix"):
        write_matlab(tmp_path / "s.npz", mesh)
    with pytest.raises(MapFileError, match="no/s.mat: cannot be written"):
        write_matlab(tmp_path / "no" / "s.mat", mesh)
    with pytest.raises(ValueError, match="the mesh has 162 vertices, .* has 642"):
        write_matlab(tmp_path / "s.mat", other, spec)
    with pytest.raises(ValueError, match="not those of the mesh"):
        moved = mesh._replace(vertices=mesh.vertices[::-1])
        write_matlab(tmp_path / "s.mat", moved, spec)
    with pytest.raises(ValueError, match="1 of them padding"):
        padded = spec._replace(mass=np.append(0, spec.mass[1:]))
        write_matlab(tmp_path / "s.mat", mesh, padded)
    assert not list(tmp_path.iterdir())
