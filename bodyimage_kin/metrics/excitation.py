"""What a motion moves: the motion metric, and how much training excites each direction of what use needs.

Both are taken from recordings: of the *felt* motion, which is what a robot knows, unless an onlooker asks for the
*true* one. What was taken stands in the result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import xarray as xr
from jaxtyping import Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._checks import choice, number
from bodyimage_kin._shown import Shown
from bodyimage_kin.errors import InvalidArray, InvalidRecording
from bodyimage_kin.estimators import edges
from bodyimage_kin.metrics._whitening import Metric, metric_root, square_root

__all__ = ["Excitation", "excitation", "motion_metric"]

Motion: TypeAlias = xr.Dataset | ArrayLike
"""A recording, or joint displacements (*steps, p) [rad or m]."""

Of: TypeAlias = Literal["felt", "true"] | str
"""Whose motion: as the joints feel it, or the simulator's truth."""


@dataclass(frozen=True, eq=False)
class Excitation(Shown):
    """How much a training motion excites each direction of the motion a Jacobian is used for.

    The solution of ``G_train v = mu G_use v`` with mean Grams, mu being the ratio of mean squared motion along v.

    Attributes:
        eigenvalues: mu, (p,), descending.
        eigenvectors: v as columns, (p, p) [1/rad], with ``v' G_use v = 1``.
        motion_metric: G_use, (p, p) [rad^2], of :func:`motion_metric`.
        of: ``"felt"`` or ``"true"`` motion.
        cut: A direction counts as excited when mu is at least this.
    """

    eigenvalues: Float[np.ndarray, "p"]
    eigenvectors: Float[np.ndarray, "p p"]
    motion_metric: Float[np.ndarray, "p p"]
    of: Of
    cut: float = 0.1

    def projector(self, cut: float | int | None = None, metric: Metric | None = None) -> Float[np.ndarray, "p p"]:
        """The orthogonal projector on the excited motions, in a whitened space (rows of ``J W^1/2``).

        Args:
            cut: Keep mu of at least this; the excitation's own cut when None.
            metric: W, ``"identity"`` or (p, p); the excitation's own motion metric when None.

        Raises:
            InvalidConfig: A cut that is negative or not finite.
            InvalidArray: A metric that is none.
        """
        kept = self.eigenvalues >= (self.cut if cut is None else number("cut", cut, least=0.0))
        own = metric is None or (not isinstance(metric, str) and np.array_equal(metric, self.motion_metric))
        if own:
            directions = square_root(self.motion_metric, len(self.motion_metric)) @ self.eigenvectors[:, kept]
            return np.asarray(directions @ directions.T)
        # The unexcited directions v see nothing of an excited motion dq = G_use v_excited: v' dq = 0, in any metric.
        p = len(self.motion_metric)
        root = metric_root(metric, p)
        blind = self.eigenvectors[:, ~kept] if root is None else root @ self.eigenvectors[:, ~kept]
        U, S, _ = np.linalg.svd(blind, full_matrices=False)
        U = U[:, p * np.finfo(float).eps * S.max(initial=0) < S]
        return np.asarray(np.eye(p) - U @ U.T)


def motion_metric(recording: Motion, of: Of = "felt") -> Float[np.ndarray, "p p"]:
    """The metric of a motion, ``mean(dq dq')``: how much a unit of motion of each joint matters where it is used.

    In this metric the squared norm of a Jacobian is the mean squared image displacement that the motion causes.

    Args:
        recording: A recording, its motion between successive samples (of a scattered one, along the edges between
            postures near each other); or joint displacements (*steps, p) [rad or m].
            Rows that are not finite are left out.
        of: The ``"felt"`` motion of a recording or its ``"true"`` one; of displacements, what they are.

    Returns:
        Symmetric [rad^2]; 1e-6 of its mean diagonal stands on the diagonal, so that it can be inverted.

    Raises:
        InvalidConfig: Neither felt nor true.
        InvalidRecording: A recording without such postures.
        InvalidArray: No numbers, no finite row, or nothing that moves.
    """
    gram = _mean_gram(recording, of, "the motion")
    if not np.trace(gram) > 0:
        raise InvalidArray("the motion does not move, so it weighs no joint; give that of a moving robot")
    return np.asarray(gram + 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram)))


def excitation(training: Motion, use: Motion, of: Of = "felt", cut: float | int = 0.1) -> Excitation:
    """Excitation of the motion of use by the motion of training.

    Args:
        training: The recording that is learned from, or its joint displacements (*steps, p) [rad or m]; rows that are
            not finite are left out.
        use: Of the motion that the Jacobian is used for, over the same time step, likewise.
        of: The ``"felt"`` motion of recordings or their ``"true"`` one; of displacements, what they are.
        cut: Threshold on mu for :meth:`Excitation.projector`.

    Raises:
        InvalidConfig: Neither felt nor true, or a cut that is negative or not finite.
        InvalidRecording: A recording without such postures.
        InvalidArray: No numbers, of different p, without a finite row, or a use that does not move.
    """
    cut = number("cut", cut, least=0.0)
    train, needed = _mean_gram(training, of, "the training motion"), motion_metric(use, of)
    if train.shape != needed.shape:
        raise InvalidArray(
            f"training has {len(train)} joints but use has {len(needed)}; give motions of the same joints"
        )
    inverse_root = np.linalg.inv(square_root(needed, len(needed)))
    whitened = inverse_root @ train @ inverse_root
    values, directions = np.linalg.eigh((whitened + whitened.T) / 2)
    return Excitation(values[::-1].clip(min=0), inverse_root @ directions[:, ::-1], needed, of, cut)


def _mean_gram(motion: Motion, of: Of, name: str) -> Float[np.ndarray, "p p"]:
    """mean(dq dq') per step, so that long and short recordings compare."""
    steps = _steps(motion, of, name)
    steps = steps.reshape(-1, steps.shape[-1])
    steps = steps[np.isfinite(steps).all(-1)]
    if len(steps) == 0:
        raise InvalidArray(f"{name} has no finite row; give the joint displacements of a recorded motion")
    return np.asarray(steps.T @ steps / len(steps))


def _steps(motion: Motion, of: Of, name: str) -> Float[np.ndarray, "*steps p"]:
    choice("of", of, ("felt", "true"))
    if not isinstance(motion, xr.Dataset):
        return as_float_array(motion, name, ndim=1)
    variable = "q" if of == "felt" else "true_q"
    if variable not in motion:
        raise InvalidRecording(f"{name}: the recording has no variable '{variable}', its {of} postures")
    q = as_float_array(motion[variable].values, variable, ndim=3)
    if motion.attrs.get("order", "stream") == "stream":
        return np.diff(q, axis=-2)
    q = q[np.isfinite(q).all(-1)]
    if len(q) < 2:
        raise InvalidRecording(f"{name}: the recording has {len(q)} postures; give one of a motion")
    ends = edges(q)
    return q[ends[:, 1]] - q[ends[:, 0]]
