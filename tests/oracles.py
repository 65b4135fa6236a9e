"""Dense numpy oracles: the definitions, written out slowly."""

import numpy as np
import scipy.linalg
import scipy.special
from scipy.spatial.distance import cdist


def cotan(vertices, faces, mass="voronoi"):
    """Stiffness (n, n) and areas (n,), face by face and angle by angle."""
    n = len(vertices)
    stiffness, areas = np.zeros((n, n)), np.zeros(n)
    for face in faces:
        p = vertices[face]
        area = np.linalg.norm(np.cross(p[1] - p[0], p[2] - p[0])) / 2
        angle = []
        for c in range(3):
            a, b = p[(c + 1) % 3] - p[c], p[(c + 2) % 3] - p[c]
            angle.append(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
        for c in range(3):
            i, j = face[(c + 1) % 3], face[(c + 2) % 3]
            w = 1 / np.tan(angle[c]) / 2
            stiffness[[i, j], [j, i]] -= w
            stiffness[[i, j], [i, j]] += w
            if mass == "barycentric":
                areas[face[c]] += area / 3
            elif max(angle) > np.pi / 2:
                areas[face[c]] += area / (2 if angle[c] > np.pi / 2 else 4)
            else:
                for d in ((c + 1) % 3, (c + 2) % 3):
                    side = p[3 - c - d] - p[c]  # opposite to corner d
                    areas[face[c]] += side @ side / np.tan(angle[d]) / 8
    return stiffness, areas


def eigenpairs(stiffness, areas, k):
    """First k solutions of W phi = lambda A phi, areas scaled to sum 1."""
    mass = np.diag(areas / areas.sum())
    return scipy.linalg.eigh(stiffness, mass, subset_by_index=(0, k - 1))


def brackets(vertices, faces, functions):
    """B[c, a, b] = sum over faces of area f_c n . (grad f_a x grad f_b)."""
    k = functions.shape[1]
    total = np.zeros((k, k, k))
    for face in faces:
        p, f = vertices[face], functions[face]
        normal = np.cross(p[1] - p[0], p[2] - p[0])
        area = np.linalg.norm(normal) / 2
        normal = normal / (2 * area)
        # Gradient of corner c's hat function: the opposite edge turned by 90 degrees.
        hats = [
            np.cross(normal, p[(c + 2) % 3] - p[(c + 1) % 3]) / (2 * area)
            for c in range(3)
        ]
        slope = np.stack(hats, 1) @ f
        for a in range(k):
            for b in range(k):
                turn = normal @ np.cross(slope[:, a], slope[:, b])
                total[:, a, b] += area * f.mean(0) * turn
    return total


def fit_residuals(spec_x, spec_y, desc_x, desc_y, brackets_x, brackets_y, weights):
    """C (k, k) -> all residuals of the functional map energy, in one vector.

    weights: (descriptors, laplacian, multiplication, orientation).
    brackets_x, brackets_y: (k, k, k) of both shapes.
    """
    k = len(brackets_x)
    phi, mass, desc, evals, tensor = [], [], [], [], (brackets_x, brackets_y)
    for spec, d in ((spec_x, desc_x), (spec_y, desc_y)):
        phi.append(np.asarray(spec.evecs)[:, :k])
        evals.append(np.asarray(spec.evals)[:k])
        mass.append(np.asarray(spec.mass))
        desc.append(np.asarray(d) - mass[-1] @ np.asarray(d))
    norm = np.sqrt(sum(m @ d**2 for m, d in zip(mass, desc, strict=True)) / 2)
    coef, times, turn = [], [], []
    for p, m, d, b in zip(phi, mass, desc, tensor, strict=True):
        d = d / norm
        back = p.T * m
        coef.append(back @ d)
        times.append([back @ (column[:, None] * p) for column in d.T])
        turn.append([np.tensordot(b, c, ([1], [0])) for c in coef[-1].T])
    top = max(evals[0][-1], evals[1][-1])
    mask = np.zeros((k, k))
    for i in range(k):
        for j in range(k):
            s, t = np.sqrt(evals[0][i] / top), np.sqrt(evals[1][j] / top)
            mask[i, j] = abs(1 / (s - 1j) - 1 / (t - 1j))

    def size(x, y):
        return (np.sum(np.square(x)) + np.sum(np.square(y))) / 2 / k

    sign = -1 if weights[3] < 0 else 1
    w = np.sqrt(np.abs(weights))
    carry = [w[0] * c / np.sqrt(size(*coef)) for c in coef]
    mask = w[1] * mask / np.sqrt((mask**2).mean())
    times = [w[2] * np.stack(t) / np.sqrt(size(*times)) for t in times]
    turn = [w[3] * np.stack(t) / np.sqrt(size(*turn)) for t in turn]

    def residuals(C):
        parts = [
            C @ carry[1] - carry[0],
            mask * C,
            C @ times[1] - times[0] @ C,
            C @ turn[1] - sign * turn[0] @ C,
        ]
        return np.concatenate([part.ravel() for part in parts])

    return residuals


def fit(residuals, k):
    """Minimiser of |residuals(C)|^2 with first column (1, 0, ...), by dense lstsq.

    residuals: affine in C (k, k).
    """
    start = np.zeros((k, k))
    start[0, 0] = 1
    base = residuals(start)
    free = [(i, j) for i in range(k) for j in range(1, k)]
    columns = []
    for i, j in free:
        step = start.copy()
        step[i, j] += 1
        columns.append(residuals(step) - base)
    solution = np.linalg.lstsq(np.stack(columns, 1), -base)[0]
    for (i, j), value in zip(free, solution, strict=True):
        start[i, j] = value
    return start


def neighbours(queries, points, k0, valid=None):
    """k0 nearest by brute force, ties to the lower index: (indices, distances)."""
    queries, points = np.asarray(queries, float), np.asarray(points, float)
    square = cdist(queries, points, "sqeuclidean")
    if valid is not None:
        square[:, ~np.asarray(valid)] = np.inf
    idx = np.argsort(square, axis=1, kind="stable")[:, :k0]
    dist = np.sqrt(np.take_along_axis(square, idx, 1))
    return np.where(np.isfinite(dist), idx, 0), dist


def log_kernel(near_xy, near_yx, lam_xy, lam_yx, power=1.0, unilateral_weight=1.0):
    """log K (n_x, n_y) on the union of (indices, distances) both ways, pair by pair."""
    cost_xy = np.full((len(near_xy[0]), len(near_yx[0])), np.nan)
    cost_yx = cost_xy.copy()
    for (idx, dist), cost in ((near_xy, cost_xy), (near_yx, cost_yx.T)):
        for i, j in np.argwhere(np.isfinite(dist)):
            cost[i, idx[i, j]] = dist[i, j] ** power
    asked_xy, asked_yx = ~np.isnan(cost_xy), ~np.isnan(cost_yx)
    cost = np.nan_to_num(np.where(asked_xy, cost_xy, cost_yx))
    with np.errstate(divide="ignore"):
        alone = np.log(unilateral_weight)
        both = np.logaddexp(-lam_xy * cost, -lam_yx * cost) - np.log(2)
    out = np.where(asked_xy, -lam_xy * cost + alone, -np.inf)
    out = np.where(asked_yx, -lam_yx * cost + alone, out)
    return np.where(asked_xy & asked_yx, both, out)


def sinkhorn(log_k, marginal_x, marginal_y, num_iters, relax=1.0):
    """Dense log-domain scaling, Y first: (f, g, log plan, l1 gap of all sums).

    The first and last updates are plain, and none but the first moves a scaling by more
    than a factor 100 before it is relaxed.
    """
    f, g = np.zeros(len(log_k)), np.zeros(log_k.shape[1])

    def moved(own, log_k, other, marginal, step):
        total = scipy.special.logsumexp(log_k + other, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.where(np.isfinite(total), np.log(marginal) - total, 0)
        if step == 0:
            return found
        gap = np.clip(found - own, -np.log(100), np.log(100))
        return own + (1 if step == num_iters - 1 else relax) * gap

    for step in range(num_iters):
        g = moved(g, log_k.T, f, marginal_y, step)
        f = moved(f, log_k, g, marginal_x, step)
    log_plan = f[:, None] + log_k + g
    plan = np.exp(log_plan)
    gap = np.abs(plan.sum(1) - marginal_x).sum()
    return f, g, log_plan, gap + np.abs(plan.sum(0) - marginal_y).sum()


def authors_filter(emb_x, emb_y, k0, lam, num_iters):
    """The authors' settings, exactly: plain exp, plain scalings, float64."""
    kernel = np.zeros((len(emb_x), len(emb_y)))
    for one, other, out in ((emb_x, emb_y, kernel), (emb_y, emb_x, kernel.T)):
        idx, dist = neighbours(one, other, k0)
        for i in range(len(one)):
            out[i, idx[i]] += np.exp(-lam / dist.max() * dist[i]) / 2
    u = np.ones(len(emb_x))
    for _ in range(num_iters):
        v = 1 / len(emb_y) / (kernel.T @ u)
        u = 1 / len(emb_x) / (kernel @ v)
    plan = u[:, None] * kernel * v[None]
    return plan.argmax(1), plan.argmax(0), plan


def algorithm_2(emb_x, emb_y, k0, lam, num_iters):
    """Fast Sinkhorn Filtering as the paper writes it (CVPR 2021), line by line."""
    kernel = np.zeros((len(emb_x), len(emb_y)))
    for i in range(len(emb_x)):
        dist = np.linalg.norm(emb_x[i] - emb_y, axis=1)
        for j in np.argsort(dist, kind="stable")[:k0]:
            kernel[i, j] = np.exp(-lam * dist[j] ** 2)
    a, b = np.full(len(emb_y), 1 / len(emb_y)), np.full(len(emb_x), 1 / len(emb_x))
    u = np.full(len(emb_x), 1 / len(emb_y))
    for _ in range(num_iters):
        sums = kernel.T @ u
        # A column without entries has no partner: no mass, where the paper divides.
        v = np.where(sums > 0, a / np.where(sums > 0, sums, 1), 0)
        u = b / (kernel @ v)
    plan = u[:, None] * kernel * v[None]
    return plan.argmax(1), plan.argmax(0), plan


def functional_map(T_xy, evecs_x, evecs_y, mass_x):
    """Weighted least squares by lstsq."""
    root = np.sqrt(mass_x)[:, None]
    return np.linalg.lstsq(root * evecs_x, root * evecs_y[T_xy])[0]


def nearest(emb_x, emb_y):
    """Nearest neighbours both ways."""
    T_xy = neighbours(emb_x, emb_y, 1)[0][:, 0]
    return T_xy, neighbours(emb_y, emb_x, 1)[0][:, 0]


def zoomout(spec_x, spec_y, C, ks, bidirectional=False, extra=None, extra_weight=1.0):
    """Nearest neighbour ZoomOut in the direct space, one basis size after the other.

    With `extra` columns, all are weighted.
    """
    (phi_x, mass_x), (phi_y, mass_y) = (
        (np.asarray(s.evecs), np.asarray(s.mass)) for s in (spec_x, spec_y)
    )
    C = np.asarray(C)[: ks[0], : ks[0]]
    T_xy = None
    for k, grown in zip(ks[:-1], ks[1:], strict=True):
        emb_x, emb_y = phi_x[:, :k], phi_y[:, :k] @ C.T[:k, :k]
        if extra is not None:
            emb_x, emb_y = np.c_[emb_x, extra[0]], np.c_[emb_y, extra[1]]
            if T_xy is not None:
                differ = (mass_x[:, None] * (emb_x - emb_y[T_xy]) ** 2).sum(0)
                weight = 1 / np.sqrt(differ + 0.05)
                emb_x, emb_y = emb_x * weight, emb_y * weight
            emb_x[:, k:] *= extra_weight
            emb_y[:, k:] *= extra_weight
        T_xy, T_yx = nearest(emb_x, emb_y)
        C = functional_map(T_xy, phi_x[:, :grown], phi_y[:, :grown], mass_x)
        if bidirectional:
            back = functional_map(T_yx, phi_y[:, :grown], phi_x[:, :grown], mass_y)
            C = (C + back.T) / 2
    return C


def icp(spec_x, spec_y, C, num_iters):
    """Nearest neighbour ICP in the adjoint space, C made orthonormal each time."""
    k_x, k_y = C.shape
    phi_x, phi_y = np.asarray(spec_x.evecs)[:, :k_x], np.asarray(spec_y.evecs)[:, :k_y]
    for _ in range(num_iters):
        T_xy, _ = nearest(phi_x @ C, phi_y)
        u, _, vt = np.linalg.svd(
            functional_map(T_xy, phi_x, phi_y, np.asarray(spec_x.mass)),
            full_matrices=False,
        )
        C = u @ vt
    return C


def deform(vertices, faces, mass, target, reach, updates):
    """Drawn to `target`, as rigid as possible: SVDs and a dense solve an update."""
    n = len(vertices)
    weight = np.zeros((n, n))
    for face in faces:
        for c in range(3):
            i, j, k = face[(c + 1) % 3], face[(c + 2) % 3], face[c]
            a, b = vertices[i] - vertices[k], vertices[j] - vertices[k]
            cotangent = a @ b / np.linalg.norm(np.cross(a, b))
            weight[[i, j], [j, i]] += np.clip(cotangent, 0.01, 100) / 2
    resist = np.diag(weight.sum(1)) - weight
    pull = np.diag(mass / reach**2)
    moved = target
    for _ in range(updates):
        rotation = np.zeros((n, 3, 3))
        for i in range(n):
            rest, now = vertices[i] - vertices, moved[i] - moved
            u, _, vt = np.linalg.svd((weight[i][:, None] * now).T @ rest)
            rotation[i] = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        right = pull @ target
        for i in range(n):
            for j in np.flatnonzero(weight[i]):
                mean = (rotation[i] + rotation[j]) / 2
                right[i] += weight[i, j] * mean @ (vertices[i] - vertices[j])
        moved = np.linalg.solve(resist + pull, right)
    return moved


def farthest_points(points, real, num):
    """Vertices, each the farthest from all before it; the first, from the mean."""
    size = np.where(real, (points**2).sum(1), -1)
    chosen = [int(size.argmax())]
    while len(chosen) < num:
        gap = ((points[:, None] - points[chosen][None]) ** 2).sum(2).min(1)
        chosen.append(int(np.where(real, gap, -1).argmax()))
    return np.array(chosen)


def unbalanced(log_k, marginal_x, marginal_y, slack, num_iters):
    """Dense plain updates of unbalanced Sinkhorn, Y first: (log u, log v, plan)."""
    a, b = np.asarray(marginal_x), np.asarray(marginal_y)
    kernel, power = np.exp(log_k), -1 / (1 + slack)
    u = np.ones(len(kernel))
    for _ in range(num_iters):
        v = b * (kernel.T @ u) ** power
        u = a * (kernel @ v) ** power
    return np.log(u), np.log(v), u[:, None] * kernel * v
