"""F of equation 7: the image that a posture suggests, learned from the hand while it was seen."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from jaxtyping import Float

from bodyimage_kin._shown import Shown
from bodyimage_kin.body_image._checks import number, postures, variable, whole
from bodyimage_kin.errors import InvalidArray, InvalidRecording

__all__ = ["PostureToImage"]


@dataclass(frozen=True, eq=False)
class PostureToImage(Shown):
    """A ridge regression from posture to hand image, on products of joint values (F of equation 7).

    It has seen nothing of the postures at which the hand is hidden: there it extrapolates, as the paper's F must.

    Attributes:
        mean: (p,) of the seen postures [rad or m].
        scale: (p,) their standard deviation [rad or m].
        degree: Of the products of standardised joint values.
        coefficients: (features, m) [m].
        offset: (m,) [m].
    """

    mean: Float[np.ndarray, " p"]
    scale: Float[np.ndarray, " p"]
    degree: int
    coefficients: Float[np.ndarray, "features m"]
    offset: Float[np.ndarray, " m"]

    @classmethod
    def fit(cls, exp: Any, degree: int = 2, ridge: float | int = 1e-4) -> PostureToImage:
        """Fit to every sample whose hand image was seen.

        Args:
            exp: Experience: ``q`` (trial, time, joint) [rad or m] and ``hand_image`` (trial, time, axis) [m], NaN where
                unseen.
            degree: Of the products of joint values: 1 is linear, 2 adds squares and pairs.
            ridge: Penalty on the squared coefficients, against the mean squared error.

        Raises:
            InvalidRecording: A variable is missing, or the hand was never seen.
            InvalidConfig: A degree below 1, or a negative ridge.
        """
        degree, ridge = whole("degree", degree, 1), number("ridge", ridge, 0.0)
        q, image = postures(exp), variable(exp, "hand_image", "trial", "time", "axis")
        seen = np.isfinite(q).all(axis=-1) & np.isfinite(image).all(axis=-1)
        if not seen.any():
            raise InvalidRecording("the hand is seen in no sample; fit on an experience in front of the face")
        q, image = q[seen], image[seen]
        mean, scale = q.mean(axis=0), q.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        features = _products((q - mean) / scale, degree)
        centre, offset = features.mean(axis=0), image.mean(axis=0)
        # Least squares with the penalty as extra rows: no normal equations, so no squared condition number.
        penalty = np.sqrt(ridge * len(q)) * np.eye(features.shape[1])
        rows = np.vstack([features - centre, penalty])
        right = np.vstack([image - offset, np.zeros((len(penalty), image.shape[1]))])
        coefficients = np.linalg.lstsq(rows, right)[0]
        return cls(mean, scale, degree, coefficients, offset - centre @ coefficients)

    def __call__(self, q: Any) -> Float[np.ndarray, "samples m"]:
        """Image foreseen for each posture [m on the screen].

        Args:
            q: (samples, p) postures [rad or m].

        Raises:
            InvalidArray: Another shape.
        """
        felt = np.asarray(q, dtype=np.float64)
        if felt.ndim != 2 or felt.shape[1] != len(self.mean):
            raise InvalidArray(f"q has shape {felt.shape}; give postures of shape (samples, {len(self.mean)})")
        return np.asarray(_products((felt - self.mean) / self.scale, self.degree) @ self.coefficients + self.offset)


def _products(z: Float[np.ndarray, "samples p"], degree: int) -> Float[np.ndarray, "samples features"]:
    """Every product of 1 to ``degree`` columns, with repetition."""
    chosen = (combinations_with_replacement(range(z.shape[1]), order) for order in range(1, degree + 1))
    return np.stack([z[:, list(columns)].prod(axis=1) for group in chosen for columns in group], axis=1)
