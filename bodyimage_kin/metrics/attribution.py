"""Why a learned Jacobian is wrong: depth it could not know, motion it never saw, what changes with posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bodyimage_kin.errors import InvalidArray, InvalidConfig
from bodyimage_kin.metrics._inputs import ArrayInput, as_floats, as_pair, square_root
from bodyimage_kin.metrics.jacobian import mean_gram, unit_metric


@dataclass(frozen=True, eq=False)
class Excitation:
    """How much a training motion excites each direction of the motion a Jacobian is used for.

    The solution of ``G_train v = mu G_use v`` with mean Grams, mu being the ratio of mean squared motion along v.

    Attributes:
        eigenvalues: mu, (p,), descending.
        eigenvectors: v as columns, (p, p) [1/rad], with ``v' G_use v = 1``.
        metric: G_use, (p, p) [rad^2], the unit metric ``"use"``.
        cut: A direction counts as excited when mu is at least this.
    """

    eigenvalues: Float[np.ndarray, "p"]
    eigenvectors: Float[np.ndarray, "p p"]
    metric: Float[np.ndarray, "p p"]
    cut: float = 0.1

    def projector(self, cut: float | None = None) -> Float[np.ndarray, "p p"]:
        """The orthogonal projector on the excited directions, in the whitened space (rows of ``J W^1/2``).

        Args:
            cut: Keep mu of at least this; the excitation's own cut when None.
        """
        kept = self.eigenvalues >= (self.cut if cut is None else cut)
        directions = square_root(self.metric, len(self.metric)) @ self.eigenvectors[:, kept]
        return np.asarray(directions @ directions.T)


def excitation(train_dq: ArrayInput, use_dq: ArrayInput, cut: float = 0.1) -> Excitation:
    """Excitation of the motion of use by the motion of training.

    Args:
        train_dq: Joint displacements seen in training, (*samples, p) [rad or m]; rows that are not finite are left out.
        use_dq: Those of the probe motion, over the same time step, (*samples, p) [rad or m], likewise.
        cut: Threshold on mu for :meth:`Excitation.projector`.

    Raises:
        InvalidArray: No float arrays, of different p, without a finite row, or a probe that does not move.
        InvalidConfig: A cut that is negative or not finite.
    """
    if not 0 <= cut < np.inf:
        raise InvalidConfig(f"cut is {cut}; give a finite number of at least 0")
    train, use = mean_gram(train_dq, "train_dq"), unit_metric("use", dq=use_dq)
    if train.shape != use.shape:
        raise InvalidArray(f"train_dq has {len(train)} joints but use_dq {len(use)}; they must be of the same joints")
    inverse_root = np.linalg.inv(square_root(use, len(use)))
    whitened = inverse_root @ train @ inverse_root
    values, directions = np.linalg.eigh((whitened + whitened.T) / 2)
    return Excitation(values[::-1].clip(min=0), inverse_root @ directions[:, ::-1], use, float(cut))


@dataclass(frozen=True)
class Attribution:
    """The squared pooled relative error as a sum of four orthogonal parts, each nonnegative and over |J|^2.

    Attributes:
        depth: ``(1 - s)^2 |Jh|^2``: the one scale that a monocular learner cannot know.
        mean_excited: ``|mean(s Jh - J) P|^2``: a constant error along directions that the training motion excited.
        mean_unexcited: ``|mean(s Jh - J) (I - P)|^2``: the same along those it did not.
        variation: ``mean |dev(s Jh - J)|^2``: what changes with posture, and no constant Jacobian can follow.
        scale: s = <Jh, J> / |Jh|^2, the best single scale of the estimate; 0 for a zero estimate.
    """

    depth: float
    mean_excited: float
    mean_unexcited: float
    variation: float
    scale: float

    @property
    def total(self) -> float:
        """The sum of the parts, ``pooled_relative_error(...) ** 2``."""
        return self.depth + self.mean_excited + self.mean_unexcited + self.variation


@np.errstate(all="ignore")
def attribute(true: ArrayInput, estimated: ArrayInput, metric: ArrayInput | None, projector: ArrayInput) -> Attribution:
    """Attribute the error of any learned Jacobian over a set of postures, exactly.

    With ``<A, B> = mean of tr(A W B')`` over postures, s makes ``s Jh - J`` orthogonal to Jh, so the depth splits off
    by Pythagoras; mean and deviation over postures, and P and I - P, are orthogonal as well.

    Args:
        true: (*batch, m, p) [m/rad].
        estimated: The same shape; for a displacement f(dq) the caller chooses which of its Jacobians.
        metric: Unit metric W, (p, p), such as :attr:`Excitation.metric`; the identity when None.
        projector: P, (p, p), an orthogonal projector in the whitened space, such as :meth:`Excitation.projector`.

    Returns:
        The parts. Postures with a non-finite entry are left out; everything is NaN when none is left or the true
        Jacobians vanish. A zero estimate has no scale: s is set to 0, the depth is 0, the other parts sum to 1.

    Raises:
        InvalidArray: Shapes that differ, a metric that is none, or no orthogonal projector.
    """
    J, Jh = as_pair(true, estimated, ("true", "estimated"), ndim=2)
    m, p = J.shape[-2:]
    P = as_floats(projector, "projector", ndim=2)
    if P.shape != (p, p) or not (np.abs(P - P.T).max() < 1e-9 and np.abs(P @ P - P).max() < 1e-9):
        raise InvalidArray(f"projector must be an orthogonal projector, symmetric, ({p}, {p}) and its own square")
    finite = np.isfinite(J).all((-1, -2)) & np.isfinite(Jh).all((-1, -2))
    root = square_root(metric, p)
    J, Jh = ((a[finite].reshape(-1, p) @ root).reshape(-1, m, p) for a in (J, Jh))
    size = float(np.vdot(J, J))
    if not size > 0:
        return Attribution(*[float("nan")] * 5)
    estimated_size = float(np.vdot(Jh, Jh))
    s = float(np.vdot(Jh, J)) / estimated_size if estimated_size > 0 else 0.0
    residual = s * Jh - J
    mean = residual.mean(0)
    deviation = residual - mean
    excited = mean @ P
    return Attribution(
        depth=(1 - s) ** 2 * estimated_size / size,
        mean_excited=float((excited**2).sum()) * len(J) / size,
        mean_unexcited=float(((mean - excited) ** 2).sum()) * len(J) / size,
        variation=float(np.vdot(deviation, deviation)) / size,
        scale=s,
    )
