"""An arm of three links in a plane, in closed form: its tip is the image."""

import numpy as np

LINKS = np.array([0.1, 0.1, 0.06])


def image(q):
    """Where the tip is, (*batch, 2) [m]."""
    angles = q.cumsum(-1)
    return np.stack([np.cos(angles) @ LINKS, np.sin(angles) @ LINKS], -1)


def jacobian(q):
    """Its derivative, (*batch, 2, 3) [m/rad]."""
    angles = q.cumsum(-1)
    columns = np.stack([-np.sin(angles) * LINKS, np.cos(angles) * LINKS], -2)
    return columns[..., ::-1].cumsum(-1)[..., ::-1]
