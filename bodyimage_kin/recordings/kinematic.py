"""Motion without dynamics: the hand is led along a path, the joints follow with the least displacement."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin.body import reach
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import Unreachable

__all__ = ["follow"]

_ITERATIONS = 12
_CLOSE = 1e-10


@torch.no_grad()
def follow(
    body: Embodiment,
    centres: Float[np.ndarray, "time 3"],
    rest: Float[np.ndarray, "p"],
    pull: float,
) -> Float[np.ndarray, "time p"]:
    """Postures that lead the hand's centre along a path, by differential inverse kinematics.

    From one sample to the next the joints move by ``J^+ dx`` and, within the null space of J, towards the rest posture
    by the share ``pull``; Newton steps of the same kind close what the linearisation leaves (to 1e-10 m). Joints stop
    at their limits.

    Args:
        body: The embodiment.
        centres: The hand's centre, in the axes of the body's ``front_link`` [m].
        rest: Rest posture; the first posture is displaced least from it [rad].
        pull: Share of the way to the rest posture that is gone at each sample where the hand leaves it free, 0 to 1.

    Raises:
        Unreachable: A place the hand does not get to within the joint limits.
    """
    lower, upper = body.felt_robot.lower, body.felt_robot.upper
    targets, home = torch.from_numpy(centres), torch.from_numpy(rest)
    q, reached = reach.least_displacement(body.hand_in_front_and_jacobian, targets[:1], home, lower, upper)
    if not bool(reached.all()):
        raise Unreachable("the hand cannot reach the path's first point within the joint limits")
    postures = torch.empty(len(targets), body.p, dtype=torch.float64)
    postures[0] = q[0]
    for index in range(1, len(targets)):
        drift = pull * (home - q)
        for iteration in range(_ITERATIONS):
            position, jacobian = body.hand_in_front_and_jacobian(q)
            error = targets[index] - position
            if iteration > 0 and bool((error.abs() < _CLOSE).all()):
                break
            q = reach.step(jacobian, error, drift, q, lower, upper)
            drift = torch.zeros_like(q)
        else:
            raise Unreachable(f"the hand cannot follow the path at sample {index} within the joint limits")
        postures[index] = q[0]
    return postures.numpy()
