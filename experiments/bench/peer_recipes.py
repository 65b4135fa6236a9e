"""What each package does from two meshes to a map, as its users would write it.

Functions (mesh_x, mesh_y) -> T_xy. Packages are imported when a recipe is called, so
that a process which runs one of them loads nothing of the others.
"""

from typing import Any

import numpy as np

# Eigenpairs; sizes of ZoomOut; size of the first fit, of which ZoomOut takes the block.
WHOLE, START, STEP, FITTED = 150, 20, 5, 30
# Found on man_walk to man_up: with those of its notebooks (1, 0.01, 0.1, 0.1), or with
# pyFM's, the map is wrong, as the Laplacians' term is not scaled by the eigenvalues.
GEOMFUM_WEIGHTS = {"descriptors": 100, "laplacian": 1e6, "products": 1, "sides": 1}
# Of the displacements: how smooth, and over which distance (the area is 1).
CPD_ALPHA, CPD_BETA, CPD_ROUNDS, CPD_EIGENPAIRS = 2.0, 0.2, 50, 100


def jfsf(mesh_x, mesh_y) -> np.ndarray:
    """`jfsf.match` as it is, without its cache of spectra."""
    import jfsf

    return np.asarray(jfsf.match(mesh_x, mesh_y, cache=False).T_xy)


def pyfm(mesh_x, mesh_y) -> np.ndarray:
    """pyFM: its README's fit to wave kernel signatures, ZoomOut, nearest neighbours."""
    from pyFM.functional import FunctionalMapping
    from pyFM.mesh import TriMesh
    from pyFM.refine.zoomout import zoomout_refine
    from pyFM.spectral import FM_to_p2p

    meshes = [TriMesh(m.vertices, m.faces, normalize=True) for m in (mesh_y, mesh_x)]
    model = FunctionalMapping(*meshes)
    model.preprocess(n_descr=100, descr_type="WKS", subsample_step=5, k_process=WHOLE)
    model.fit(K=(FITTED, FITTED), w_descr=1, w_lap=0.1, w_dcomm=1, w_orient=1)
    assert model.FM_12 is not None
    C_yx = zoomout_refine(
        model.FM_12[:START, :START],
        model.mesh1.eigenvectors,
        model.mesh2.eigenvectors,
        nit=(WHOLE - START) // STEP,
        step=STEP,
        A2=model.mesh2.A,
    )
    own, other = model.mesh2.eigenvectors, model.mesh1.eigenvectors
    return np.asarray(FM_to_p2p(C_yx, other, own))


def geomfum(mesh_x, mesh_y) -> np.ndarray:
    """geomfum: the same steps as `pyfm`.

    With scikit-learn's brute force in place of its k-d tree, which takes ten times as
    long in so many dimensions; and with scipy's optimiser called as geomfum calls it,
    since its own module of it needs geomstats, which no recent numpy can load.
    """
    import importlib.util  # noqa: F401 (geomfum uses it, and does not import it)

    from geomfum.convert import P2pFromFmConverter
    from geomfum.descriptor.pipeline import (
        ArangeSubsampler,
        DescriptorPipeline,
        L2InnerNormalizer,
    )
    from geomfum.descriptor.spectral import WaveKernelSignature, WksDefaultDomain
    from geomfum.functional_map import (
        FactorSum,
        LBCommutativityEnforcing,
        OperatorCommutativityEnforcing,
        SpectralDescriptorPreservation,
    )
    from geomfum.refine import ZoomOut
    from geomfum.shape import TriangleMesh
    from scipy.optimize import minimize
    from sklearn.neighbors import NearestNeighbors

    class Brute:
        n_neighbors = 1

        def __call__(self, X, Y):
            search = NearestNeighbors(n_neighbors=1, algorithm="brute").fit(Y)
            return search.kneighbors(X, return_distance=False)

    shapes: Any = (
        TriangleMesh(mesh.vertices / np.sqrt(_area(mesh)), mesh.faces)
        for mesh in (mesh_y, mesh_x)
    )
    y, x = shapes
    signature = WaveKernelSignature(domain=WksDefaultDomain(n_domain=100))
    steps = [signature, ArangeSubsampler(subsample_step=5), L2InnerNormalizer()]
    for shape in (y, x):
        shape.laplacian.find_spectrum(spectrum_size=WHOLE, set_as_basis=True)
    pipeline: Any = DescriptorPipeline(steps)
    desc_y, desc_x = (pipeline.apply(shape) for shape in (y, x))
    _use(FITTED, x, y)
    weight, operators = GEOMFUM_WEIGHTS, OperatorCommutativityEnforcing
    energy = FactorSum(
        [
            SpectralDescriptorPreservation(
                y.basis.project(desc_y),
                x.basis.project(desc_x),
                weight=weight["descriptors"],
            ),
            LBCommutativityEnforcing.from_bases(
                y.basis, x.basis, weight=weight["laplacian"]
            ),
            operators.from_multiplication(
                y.basis, desc_y, x.basis, desc_x, weight=weight["products"]
            ),
            operators.from_orientation(y, desc_y, x, desc_x, weight=weight["sides"]),
        ]
    )
    matrix = lambda flat: flat.reshape(FITTED, FITTED)
    fitted = minimize(
        lambda flat: float(energy(matrix(flat))),
        np.zeros(FITTED**2),
        jac=lambda flat: np.asarray(energy.gradient(matrix(flat))).ravel(),
        method="L-BFGS-B",
    )
    convert = P2pFromFmConverter(neighbor_finder=Brute())
    zoomout = ZoomOut(
        nit=(WHOLE - START) // STEP, step=STEP, p2p_from_fm_converter=convert
    )
    _use(START, x, y)
    C_yx = zoomout(matrix(fitted.x)[:START, :START], y.basis, x.basis)
    _use(WHOLE, x, y)
    return np.asarray(convert(C_yx, y.basis, x.basis)).ravel()


def pycpd(mesh_x, mesh_y) -> np.ndarray:
    """pycpd: coherent point drift of X onto Y, then nearest points.

    It knows points only, and shapes must lie as they are to be matched.
    """
    from pycpd import DeformableRegistration
    from scipy.spatial import KDTree

    x, y = (mesh.vertices / np.sqrt(_area(mesh)) for mesh in (mesh_x, mesh_y))
    x, y = x - x.mean(0), y - y.mean(0)
    drift = DeformableRegistration(
        X=y,
        Y=x,
        alpha=CPD_ALPHA,
        beta=CPD_BETA,
        max_iterations=CPD_ROUNDS,
        low_rank=True,
        num_eig=CPD_EIGENPAIRS,
    )
    return np.asarray(KDTree(y).query(drift.register()[0])[1])


def _area(mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _use(size: int, *shapes) -> None:
    for shape in shapes:
        shape.basis.use_k = size
