"""Plain numpy: the evidence for a map, written out face by face and map by map."""

import math

import numpy as np


def stretches(rest, moved, faces):
    """Areas (m,), and singular values (m, 2) of each triangle's map, smaller first."""
    areas, values = [], []
    for face in faces:
        before, after = (p[face[1:]] - p[face[0]] for p in (rest, moved))
        areas.append(np.linalg.norm(np.cross(*before)) / 2)
        gradient = after.T @ np.linalg.pinv(before.T)
        values.append(np.linalg.svd(gradient)[1][1::-1])
    return np.array(areas), np.array(values)


def normals(points, faces):
    """Of the vertices, weighted by area."""
    total = np.zeros_like(points)
    for face in faces:
        a, b, c = points[face]
        total[face] += np.cross(b - a, c - a)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def bending(spec, moved, other, T, rounding, most_sheared, most_stretch):
    """(residual, shear, area_std, normal_gap) of one direction.

    spec, other: (vertices, faces, mass) of the shape that is bent, and of its target.
    """
    (rest, faces, mass), (target, other_faces, _) = spec, other
    normal = normals(target, other_faces)[T]
    away = np.abs(((moved - target[T]) * normal).sum(1))
    spacing = np.sqrt(other[2].sum() / len(target))
    residual = max(mass @ away / mass.sum() - rounding * spacing, 0)
    alike = (normals(moved, faces) * normal).sum(1)
    gap = 1 - abs(mass @ alike / mass.sum())
    areas, values = stretches(rest, moved, faces)
    logs = np.clip(np.log(values), -most_stretch, most_stretch)
    shears, growth = logs[:, 1] - logs[:, 0], logs.mean(1)
    share, reached = areas / areas.sum(), 0.0
    for i in np.argsort(shears):
        reached += share[i]
        if reached >= 1 - most_sheared:
            break
    area_std = np.sqrt(share @ (growth - share @ growth) ** 2)
    return np.array([residual, shears[i], area_std, gap])


def weighed(figures, factors, least, as_it_is):
    """The log odds of a map, or its rank."""
    total = 0.0
    for name, factor in factors.items():
        if name == "constant":
            total += factor
        elif name in as_it_is:
            total += factor * figures[name]
        else:
            total += factor * math.log(figures[name] + least)
    return total


def confidence(z, share, missed, told, factors, most_share, missed_weight):
    """The probability; `share` is nan for a map that was not compared."""
    beaten, most = 1.0, 1.0
    if not math.isnan(share):
        most = (1 + share) / 2
        share = min(max(share, 1 - most_share), most_share)
        beaten = min(share / factors["least_share"], 1.0)
        margin = min(math.log(share / (1 - share)), factors["most_margin"])
        z = factors["constant"] + factors["log_odds"] * z + factors["margin"] * margin
    p = min(beaten / (1 + math.exp(-z)), most) ** (1 + missed_weight * missed)
    return p if told else p / 2


def share_among(maps, ranks, points, mass, distinct, scale):
    """The share of each map's odds, rival by rival.

    points: of the vertices of Y, whose distances count.
    """
    mean_square = 0.0
    for i, p in enumerate(points):
        mean_square += mass[i] * (mass @ ((points - p) ** 2).sum(1))
    unit = math.sqrt(mean_square) / mass.sum()

    def differ(a, b):
        apart = [math.dist(points[s], points[t]) for s, t in zip(a, b, strict=True)]
        return np.average(apart, weights=mass) > distinct * unit

    order = sorted(range(len(maps)), key=lambda i: (-ranks[i], i))
    shares = []
    for i in range(len(maps)):
        rivals = []
        for j in order:
            known = [maps[i], *(maps[r] for r in rivals)]
            if j != i and all(differ(maps[j], other) for other in known):
                rivals.append(j)
        others = sum(math.exp(scale * (ranks[j] - ranks[i])) for j in rivals)
        shares.append(1 / (1 + others))
    return np.array(shares)
