"""Rays and nearest points against many triangles in a tree of boxes, compiled.

A tree is given by ``low`` and ``high`` (nodes, 3), the corners of each node's box, and ``links`` (nodes, 2): the two
nodes below it, or, of a leaf, -1 less the place of its first triangle, and how many it has. Node 0 is the root.
"""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np

from bodyimage_kin._compiled import compiled

# no_type_check: a checker that wraps functions would hand numba the wrapper.


@compiled
@no_type_check
def first_hit(corners, low, high, links, origins, directions, least, most, times, found):
    """The first triangle that each ray ``origin + t direction`` meets, from either side.

    Args:
        corners: (triangles, 3, 3), in the tree's order.
        low: Of the tree.
        high: Likewise.
        links: Likewise.
        origins: (rays, 3).
        directions: (rays, 3), of any length.
        least: (rays,) t below which nothing counts.
        most: (rays,) t above which nothing counts.
        times: (rays,) where to write t; infinite where nothing is met.
        found: (rays,) where to write the triangle; -1 where nothing is met.
    """
    stack = np.empty(128, dtype=np.int64)
    inverse, e1, e2, p, s, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for ray in range(len(origins)):
        times[ray], found[ray] = np.inf, -1
        best = most[ray]
        for axis in range(3):
            d = directions[ray, axis]
            inverse[axis] = 1.0 / d if d != 0.0 else np.inf
        stack[0], top = 0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            enter, leave = least[ray], best
            for axis in range(3):
                o = origins[ray, axis]
                if directions[ray, axis] == 0.0:
                    if o < low[node, axis] or o > high[node, axis]:
                        leave = -np.inf
                    continue
                one, other = (low[node, axis] - o) * inverse[axis], (high[node, axis] - o) * inverse[axis]
                enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
            # Boxes of flat triangles are flat themselves: rounding must not lose them.
            if enter > leave + 1e-12 * (1.0 + abs(leave)):
                continue
            if links[node, 0] >= 0:
                stack[top], stack[top + 1] = links[node, 0], links[node, 1]
                top += 2
                continue
            first = -1 - links[node, 0]
            for triangle in range(first, first + links[node, 1]):
                for axis in range(3):
                    e1[axis] = corners[triangle, 1, axis] - corners[triangle, 0, axis]
                    e2[axis] = corners[triangle, 2, axis] - corners[triangle, 0, axis]
                    s[axis] = origins[ray, axis] - corners[triangle, 0, axis]
                for axis in range(3):
                    i, j = (axis + 1) % 3, (axis + 2) % 3
                    p[axis] = directions[ray, i] * e2[j] - directions[ray, j] * e2[i]
                    r[axis] = s[i] * e1[j] - s[j] * e1[i]
                volume = e1[0] * p[0] + e1[1] * p[1] + e1[2] * p[2]
                if volume == 0.0:
                    continue
                u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) / volume
                v = (directions[ray, 0] * r[0] + directions[ray, 1] * r[1] + directions[ray, 2] * r[2]) / volume
                # A ray on the edge of two triangles must meet one of them.
                if u < -1e-9 or v < -1e-9 or u + v > 1.0 + 1e-9:
                    continue
                t = (e2[0] * r[0] + e2[1] * r[1] + e2[2] * r[2]) / volume
                if least[ray] <= t <= best:
                    best = t
                    times[ray], found[ray] = t, triangle


@compiled
@no_type_check
def nearest(corners, low, high, links, points, surface, found):
    """The nearest point of any triangle to each point.

    Args:
        corners: As of :func:`first_hit`.
        low: Likewise.
        high: Likewise.
        links: Likewise.
        points: (points, 3).
        surface: (points, 3) where to write the nearest one.
        found: (points,) where to write its triangle.
    """
    stack, reach = np.empty(128, dtype=np.int64), np.empty(128)
    ab, ac, ap, near = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for index in range(len(points)):
        best = np.inf
        stack[0], reach[0], top = 0, 0.0, 1
        while top > 0:
            top -= 1
            if reach[top] >= best:
                continue
            node = stack[top]
            if links[node, 0] >= 0:
                away = np.empty(2)
                for side in range(2):
                    child = links[node, side]
                    away[side] = 0.0
                    for axis in range(3):
                        x = points[index, axis]
                        off = max(low[child, axis] - x, x - high[child, axis], 0.0)
                        away[side] += off * off
                # The nearer one is looked at first.
                farther = 0 if away[0] > away[1] else 1
                stack[top], reach[top] = links[node, farther], away[farther]
                stack[top + 1], reach[top + 1] = links[node, 1 - farther], away[1 - farther]
                top += 2
                continue
            first = -1 - links[node, 0]
            for triangle in range(first, first + links[node, 1]):
                d1 = d2 = aa = bb = cc = 0.0
                for axis in range(3):
                    ab[axis] = corners[triangle, 1, axis] - corners[triangle, 0, axis]
                    ac[axis] = corners[triangle, 2, axis] - corners[triangle, 0, axis]
                    ap[axis] = points[index, axis] - corners[triangle, 0, axis]
                    d1 += ab[axis] * ap[axis]
                    d2 += ac[axis] * ap[axis]
                    aa += ab[axis] * ab[axis]
                    bb += ac[axis] * ac[axis]
                    cc += ab[axis] * ac[axis]
                # Weights of the corners b and c: inside of the triangle, else on the nearest of its edges.
                area = aa * bb - cc * cc
                v, w = 0.0, 0.0
                inside = False
                if area > 1e-14 * aa * bb:
                    v, w = (bb * d1 - cc * d2) / area, (aa * d2 - cc * d1) / area
                    inside = v >= 0.0 and w >= 0.0 and v + w <= 1.0
                least = np.inf
                for edge in range(1 if inside else 3):
                    if inside:
                        tv, tw = v, w
                    elif edge == 0:
                        tv, tw = min(max(d1 / aa, 0.0), 1.0) if aa > 0.0 else 0.0, 0.0
                    elif edge == 1:
                        tv, tw = 0.0, min(max(d2 / bb, 0.0), 1.0) if bb > 0.0 else 0.0
                    else:
                        length = aa + bb - 2.0 * cc
                        tw = min(max((d2 - d1 + aa - cc) / length, 0.0), 1.0) if length > 0.0 else 0.0
                        tv = 1.0 - tw
                    squared = 0.0
                    for axis in range(3):
                        off = ap[axis] - tv * ab[axis] - tw * ac[axis]
                        squared += off * off
                    if squared < least:
                        least = squared
                        for axis in range(3):
                            near[axis] = corners[triangle, 0, axis] + tv * ab[axis] + tw * ac[axis]
                if least < best:
                    best = least
                    found[index] = triangle
                    for axis in range(3):
                        surface[index, axis] = near[axis]
        if not math.isfinite(best):
            found[index] = -1
