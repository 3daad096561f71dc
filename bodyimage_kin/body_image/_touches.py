"""What a trial offers the maps: postures, touches, silence and the range of images."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Int

from bodyimage_kin.body_image._checks import float_array, postures, variable, whole
from bodyimage_kin.body_image._layout import Layout
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.recordings import first_taxel


class Touches(NamedTuple):
    """What is felt in every sample of a trial that is not padded.

    Attributes:
        q: (steps, p) postures [rad or m].
        touched: (steps, contacts) active taxels, -1 none.
        target: (steps, m) hand image.
        intensity: (steps, contacts) of each active taxel; None: not recorded.
    """

    q: Float[np.ndarray, "steps p"]
    touched: Int[np.ndarray, "steps contacts"]
    target: Float[np.ndarray, "steps m"]
    intensity: Float[np.ndarray, "steps contacts"] | None

    @property
    def first(self) -> Int[np.ndarray, " steps"]:
        """The first active taxel of each."""
        at = (self.touched >= 0).argmax(axis=1)
        return np.asarray(np.take_along_axis(self.touched, at[:, None], axis=1)[:, 0])


def touches(exp: Any, hand: Any, trial: int, layout: Layout) -> Touches:
    """What a trial offers.

    Args:
        exp: Experience, as for `BodyImage.learn`.
        hand: (trial, time, axis) [m].
        trial: Which trial.
        layout: The taxels.

    Raises:
        InvalidRecording: A variable is missing, no samples, or a taxel that is none of the skin.
        InvalidConfig: No such trial.
        InvalidArray: ``hand`` does not match the recording.
    """
    q = postures(exp)
    trial = whole("trial", trial, 0, len(q))
    target = hand_array(hand, q.shape[:2])[trial]
    first_taxel(exp)  # refuses what is no touch
    touched = variable(exp, "touched", "trial", "time", "contact")[trial]
    touched = np.where(np.isnan(touched), -1, touched).astype(np.int64) if touched.dtype.kind == "f" else touched
    felt = np.isfinite(q[trial]).all(axis=1)
    if not felt.any():
        raise InvalidRecording(f"trial {trial} has no samples: not one posture q is finite")
    touched = touched[felt]
    if touched.max(initial=-1) >= layout.count:
        what = f"a {layout.shape} grid ends" if layout.grid else "the skin ends"
        raise InvalidRecording(f"taxel {touched.max()} was touched, but {what} at {layout.count - 1}")
    intensity = None
    if "intensity" in exp:
        intensity = np.asarray(variable(exp, "intensity", "trial", "time", "contact")[trial][felt], dtype=np.float64)
    return Touches(q[trial][felt], np.asarray(touched, dtype=np.int64), target[felt], intensity)


def hand_array(hand: Any, samples: tuple[int, ...]) -> Float[np.ndarray, "trial time m"]:
    """Return a hand image as (trial, time, m) [m], whatever it came as.

    Raises:
        InvalidArray: Not floats, or not one image for each of the ``samples`` (trial, time).
    """
    if isinstance(hand, xr.DataArray):
        if set(hand.dims) != {"trial", "time", "axis"}:
            raise InvalidArray(f"hand has dimensions {hand.dims}; they must be ('trial', 'time', 'axis')")
        hand = hand.transpose("trial", "time", "axis").to_numpy()
    m = np.shape(hand)[-1] if np.ndim(hand) == 3 else 2
    return float_array("hand", hand, (*samples, m))


def image_bounds(images: Any, m: int, image_range: Any = None) -> Float[np.ndarray, "m 2"]:
    """Lowest and highest of each axis [m]: as given, else over the finite ones of ``images`` (..., m).

    Raises:
        InvalidRecording: Not one image is finite, and no range is given.
        InvalidArray: ``image_range`` is not (m, 2), or not finite and in order.
    """
    if image_range is not None:
        bounds = float_array("image_range", image_range, (m, 2))
        if not (np.isfinite(bounds).all() and (bounds[:, 0] <= bounds[:, 1]).all()):
            raise InvalidArray("image_range must be finite and in order: (lowest, highest) for each axis")
        return bounds
    finite = images[np.isfinite(images).all(axis=-1)]
    if len(finite) == 0:
        raise InvalidRecording("no hand image is finite, neither experienced nor estimated; give image_range")
    return np.stack([finite.min(axis=0), finite.max(axis=0)], axis=1)


def images_known(exp: xr.Dataset, hand: Any) -> Float[np.ndarray, "trial time m"]:
    """The experienced hand image [m] where the hand was ever seen, else the estimated one."""
    if "hand_image" in exp:
        experienced = variable(exp, "hand_image", "trial", "time", "axis")
        if np.isfinite(experienced).all(axis=-1).any():
            return np.asarray(experienced, dtype=np.float64)
    return hand_array(hand, postures(exp).shape[:2])


def silent(steps: int, silence: float, stream: np.random.SeedSequence) -> Bool[np.ndarray, " steps"]:
    """Which steps' touches go unnoticed; drawn for every step, so that no draw depends on what was touched."""
    return np.random.default_rng(stream).random(steps) < silence
