"""The arithmetic of reaching, compiled: for one posture it is so little that calls of torch cost far more."""

from __future__ import annotations

import math
from typing import no_type_check

import numpy as np

from bodyimage_kin._compiled import compiled

# no_type_check: a checker that wraps functions would hand numba the wrapper.


@compiled
@no_type_check
def step(jacobian, error, pull, q, lower, upper, damping, longest, result):
    """One step of least displacement at each posture; see `bodyimage_kin.body.reach.step`.

    Args:
        jacobian: (count, d, p) at q.
        error: (count, d) what remains to the target.
        pull: (count, p) where the joints would go if the point let them.
        q: (count, p).
        lower: (p,) joint limits.
        upper: (p,) joint limits.
        damping: Relative to the Jacobian's size.
        longest: Length that a step is cut down to.
        result: (count, p) where to.
    """
    count, d, p = jacobian.shape
    factor, wanted = np.empty((d, d)), np.empty(d)
    change, free = np.empty(p), np.empty(p)
    for k in range(count):
        free[:] = 1.0
        for _ in range(p):
            # J J' + damping, then its Cholesky factor in place.
            for i in range(d):
                for j in range(i + 1):
                    total = 0.0
                    for a in range(p):
                        total += free[a] * jacobian[k, i, a] * jacobian[k, j, a]
                    factor[i, j] = total
            size = 1e-30
            for i in range(d):
                size += factor[i, i]
            for i in range(d):
                factor[i, i] += damping * damping * size
            for j in range(d):
                for i in range(j, d):
                    total = factor[i, j]
                    for a in range(j):
                        total -= factor[i, a] * factor[j, a]
                    factor[i, j] = math.sqrt(total) if i == j else total / factor[j, j]
            for i in range(d):
                total = error[k, i]
                for a in range(p):
                    total -= free[a] * jacobian[k, i, a] * pull[k, a]
                for a in range(i):
                    total -= factor[i, a] * wanted[a]
                wanted[i] = total / factor[i, i]
            for i in range(d - 1, -1, -1):
                total = wanted[i]
                for a in range(i + 1, d):
                    total -= factor[a, i] * wanted[a]
                wanted[i] = total / factor[i, i]
            for a in range(p):
                total = pull[k, a]
                for i in range(d):
                    total += jacobian[k, i, a] * wanted[i]
                change[a] = free[a] * total
            held = False
            for a in range(p):
                outwards = (q[k, a] <= lower[a] and change[a] < 0.0) or (q[k, a] >= upper[a] and change[a] > 0.0)
                if free[a] and outwards:
                    free[a] = 0.0
                    held = True
            if not held:
                break
        length = 0.0
        for a in range(p):
            length += change[a] * change[a]
        length = math.sqrt(length)
        share = longest / length if length > longest else 1.0
        for a in range(p):
            result[k, a] = min(max(q[k, a] + share * change[a], lower[a]), upper[a])


@compiled
@no_type_check
def point_in_frame(pose, jacobian, offset, frame, frame_jacobian, position, moved):
    """A link's point in the axes of another link, and its derivative by the joints.

    Args:
        pose: (count, 4, 4) of the point's link, in the root.
        jacobian: (count, 6, p) of the same, in the root's axes.
        offset: (3,) the point in its link.
        frame: (count, 4, 4) of the other link; or one for all.
        frame_jacobian: (count, 6, p); or one for all.
        position: (count, 3) where to.
        moved: (count, 3, p) where to.
    """
    p = jacobian.shape[2]
    arm, away, speed = np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(pose)):
        f = n if len(frame) > 1 else 0
        J, F = jacobian[n], frame_jacobian[f]
        for i in range(3):
            arm[i] = pose[n, i, 0] * offset[0] + pose[n, i, 1] * offset[1] + pose[n, i, 2] * offset[2]
            away[i] = pose[n, i, 3] + arm[i] - frame[f, i, 3]
        for i in range(3):
            position[n, i] = frame[f, 0, i] * away[0] + frame[f, 1, i] * away[1] + frame[f, 2, i] * away[2]
        for a in range(p):
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                # w x arm moves the point, w_frame x away the frame that looks at it.
                speed[i] = J[i, a] + J[3 + j, a] * arm[k] - J[3 + k, a] * arm[j]
                speed[i] -= F[i, a] + F[3 + j, a] * away[k] - F[3 + k, a] * away[j]
            for i in range(3):
                moved[n, i, a] = frame[f, 0, i] * speed[0] + frame[f, 1, i] * speed[1] + frame[f, 2, i] * speed[2]
