"""Dense numpy oracles of the energies that rank maps, from the formulas of jfsf."""

import math

import numpy as np


def nearest(emb_x, emb_y):
    """For each row of emb_x the nearest of emb_y, the first among equals."""
    found = []
    for row in np.asarray(emb_x, float):
        apart = [np.linalg.norm(row - other) for other in np.asarray(emb_y, float)]
        found.append(apart.index(min(apart)))
    return found


def maps_of(C, phi_x, phi_y):
    """T_xy and T_yx, nearest neighbours of Phi_X and Phi_Y C^T."""
    emb_x, emb_y = np.asarray(phi_x)[:, : len(C)], np.asarray(phi_y)[:, : len(C)] @ C.T
    return nearest(emb_x, emb_y), nearest(emb_y, emb_x)


def energy(C, x, y, curvature_energy, compared, self_map=False):
    """E(C); x and y are (evals, phi, mass, descriptors, curvature)."""
    k = len(C)
    (evals_x, phi_x, *side_x), (evals_y, phi_y, *side_y) = x, y
    L_x, L_y = np.diag(evals_x[:k]), np.diag(evals_y[:k])
    largest = max(L_x.max(), L_y.max())
    total = np.linalg.norm(L_x @ C - C @ L_y) / (np.linalg.norm(C) * largest)
    total += np.linalg.norm(C.T @ C - np.eye(k)) / (2 * math.sqrt(k))
    T_xy, T_yx = maps_of(C, phi_x, phi_y)
    total += mismatch(side_x, side_y, T_xy, curvature_energy)
    total += mismatch(side_y, side_x, T_yx, curvature_energy)
    if self_map:
        m = min(compared, k)
        total += sum(C[i, i] for i in range(1, m)) / (m - 1)
    return total


def mismatch(x, y, T, curvature_energy):
    """M_xy; x and y are (mass, descriptors, curvature)."""
    (mass, p, h), (_, q, g) = x, y
    total = 0.0
    for i, j in enumerate(T):
        differ = 0.0
        for e in range(p.shape[1]):
            size = abs(p[i, e]) + abs(q[j, e])
            differ += abs(p[i, e] - q[j, e]) / size if size else 0.0
        bend = sum((h[i, e] - g[j, e]) ** 2 for e in range(h.shape[1]))
        total += mass[i] * (differ / p.shape[1] + curvature_energy * bend / h.shape[1])
    return total


def orientation(C, B_x, B_y, pulled_back):
    """s, the correlation of P and Q."""
    r = min(len(B_x), len(B_y), *C.shape)
    end = min(pulled_back + 1, r)
    P, Q = [], []
    for c in range(r):
        for i in range(1, end):
            for j in range(1, end):
                P.append(C[:r, i] @ B_x[c, :r, :r] @ C[:r, j])
                Q.append(C[c, :r] @ B_y[:r, i, j])
    norm = np.linalg.norm(P) * np.linalg.norm(Q)
    return np.dot(P, Q) / norm if norm else math.nan


def oriented(energy, score, sign, half, wrong):
    """E', the energy with that of the orientation."""
    if sign == 0 or math.isnan(score):
        return energy
    s = sign * score
    return energy + (wrong if s < 0 else half * (1 - s))


def log_stretch_std(C, x, y, d_x, d_y, near, collapsed):
    """The lesser of both ways; x and y are (phi, mass)."""
    (phi_x, mass_x), (phi_y, mass_y) = x, y
    T_xy, T_yx = maps_of(C, phi_x, phi_y)
    return min(
        one_way(d_x, d_y, T_xy, mass_x, near, collapsed),
        one_way(d_y, d_x, T_yx, mass_y, near, collapsed),
    )


def one_way(d_x, d_y, T, mass, near, collapsed):
    """Standard deviation of the logarithms over all pairs that count."""
    logs = []
    for i in range(len(T)):
        order = sorted(range(len(T)), key=lambda j: (d_x[i, j], j))
        for j in order[1 : 1 + near]:
            if mass[i] > 0 and mass[j] > 0 and d_x[i, j] > 0:
                logs.append(math.log(d_y[T[i], T[j]] / d_x[i, j] + collapsed))
    return np.std(logs)
