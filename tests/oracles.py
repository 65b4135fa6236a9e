"""Dense numpy oracles: the definitions, written out slowly."""

import numpy as np
import scipy.linalg


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
