"""Experiences made of displacements that are known."""

import numpy as np
import xarray as xr


def taught(dq, dr, m=2):
    """An experience of one trial with these displacements."""
    q = np.concatenate([np.zeros((1, dq.shape[1])), np.cumsum(dq, axis=0)])
    image = np.concatenate([np.zeros((1, m)), np.cumsum(dr, axis=0)])
    return xr.Dataset(
        {
            "q": (("trial", "time", "joint"), q[None]),
            "hand_image": (("trial", "time", "axis"), image[None]),
            "touched": (("trial", "time", "contact"), np.full((1, len(q), 1), -1)),
            "at_reference": (("trial", "time"), np.zeros((1, len(q)), dtype=bool)),
            "reference_image": (("axis",), np.zeros(m)),
        }
    )
