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


def scattered(q, image, block=None, **attrs):
    """A scattered recording of these postures and images, by default in contiguous fifths."""
    count = len(q)
    block = np.arange(count) * 5 // count if block is None else block
    steps = ("trial", "time")
    return xr.Dataset(
        {
            "q": ((*steps, "joint"), np.asarray(q)[None]),
            "hand_image": ((*steps, "axis"), np.asarray(image)[None], {"units": "m"}),
            "touched": ((*steps, "contact"), np.full((1, count, 1), -1)),
            "at_reference": (steps, np.zeros((1, count), dtype=bool)),
            "reference_image": (("axis",), np.zeros(np.shape(image)[1])),
            "block": (steps, np.asarray(block)[None]),
        },
        coords={"time": np.arange(count)},
        attrs={"order": "scattered", **attrs},
    )


def shuffled(exp, seed=0):
    """The same rows in another order."""
    order = np.random.default_rng(seed).permutation(exp.sizes["time"])
    return exp.isel(time=order).assign_coords(time=exp.time.values)
