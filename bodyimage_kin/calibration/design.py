"""A body linearised in its measures, and the choice of postures by what their images would tell of it.

With the information Lambda of prior and what was seen, D the derivative of a candidate's image over its noise, and
``A = mean over probes of dJ' W dJ / mean |J|^2``, the predicted squared relative error of the Jacobian at the probes is
``tr(A Lambda^-1)``, and with S = Lambda^-1 a candidate lowers it by ``tr((I + D S D')^-1 D S A S D')`` (A-optimal
design, Pukelsheim 2006, aimed at what is asked).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin.body import Embodiment
from bodyimage_kin.calibration.calibrated import Calibrated
from bodyimage_kin.calibration.prior import Prior
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators.evidence import Images
from bodyimage_kin.estimators.intrinsics import Intrinsics
from bodyimage_kin.estimators.parametric import Group, Mount, ParametricBody

__all__ = ["FREE", "Aim", "Design"]

Aim = Literal["probes", "everything", "random"]
FREE: tuple[Group, ...] = ("axes", "offsets")
"""Groups of measures that may be off where nothing is said."""
_STEP = 1e-5
"""Of the central differences in the measures [rad or m] that give how a Jacobian changes with them."""
_ROUNDS = 20
"""In which every chosen posture may be exchanged once, at most."""
_EXCHANGE = 1e-3
"""Share by which an exchange must lower the squared error, or the volume of what is unknown."""


@dataclass(frozen=True, eq=False)
class Design:
    """A body about whose measures is linearised.

    Attributes:
        images: Evidence of no rows: what a posture would show.
        offset: The hand's centre in its link [m].
        free: Indices of the measures that may be off.
        sds: (free,) of the prior.
        precision: (free, free) of prior and what was seen.
        noise: Of images [their unit].
    """

    images: Images
    offset: Float[np.ndarray, "3"]
    free: Int[np.ndarray, "free"]
    sds: Float[np.ndarray, "free"]
    precision: Float[np.ndarray, "free free"]
    noise: float

    @classmethod
    def of(
        cls, body: Embodiment, known: Calibrated | None, prior: Prior, noise: float, free: Sequence[Group] | None
    ) -> Design:
        """A body about its present measures.

        Args:
            body: As it is thought to be.
            known: What was calibrated of it; None: nothing.
            prior: How far each measure may be off.
            noise: Standard deviation of images [their unit].
            free: Groups of measures that may be off; None: those that were calibrated, else :data:`FREE`.
        """
        camera = Mount("camera", "camera", body.camera.link, body.camera.link_T_camera.numpy())
        hand = Mount("hand", "hand", body.hand.link, np.eye(4))
        intrinsics = Intrinsics.of("camera", body.camera.model)
        parametric = ParametricBody(body.felt_robot, body.joints, [camera, hand], intrinsics.parameters)
        first = parametric.parameters.index(intrinsics.parameters[0]) if intrinsics.parameters else 0
        nothing = np.zeros((0, body.p))
        images = Images(
            "images", parametric, nothing, np.zeros((0, 3)), noise, "hand", "camera", intrinsics, first,
            np.zeros((0, body.m)),
        )  # fmt: skip
        groups = tuple(free) if free is not None else (known.groups if known is not None else FREE)
        turns = {"hand: turn about x", "hand: turn about y", "hand: turn about z"}
        indices = np.array(
            [i for i, one in enumerate(parametric.parameters) if one.group in groups and one.name not in turns]
        )
        sds = prior.sds(parametric.parameters)[indices]
        precision = np.diag(sds**-2.0)
        if known is not None:
            place = {one.name: i for i, one in enumerate(known.parameters)}
            there = [place.get(parametric.parameters[i].name, -1) for i in indices]
            rows = np.array([n for n, i in enumerate(there) if i >= 0])
            columns = np.array([i for i in there if i >= 0])
            if len(rows):
                precision[np.ix_(rows, rows)] += known.fit.information[np.ix_(columns, columns)]
        return cls(images, body.hand.offset.numpy(), indices, sds, precision, noise)

    def slopes(self, q: Float[np.ndarray, "count p"]) -> Float[np.ndarray, "count m free"]:
        """Derivative of images in the measures, over their noise."""
        term = self._at(q)
        return term.residual(np.zeros(len(term.body.parameters)))[1][:, :, self.free] / self.noise

    def importance(
        self, q: Float[np.ndarray, "count p"], W: Float[np.ndarray, "p p"]
    ) -> Float[np.ndarray, "free free"]:
        """``A``: mean of ``dJ' W dJ`` over postures, over the mean of ``|J|^2``."""
        term = self._at(q)
        size = len(term.body.parameters)
        J = term.jacobian(np.zeros(size))
        changes = []
        for index in self.free:
            step = np.zeros(size)
            step[index] = _STEP
            changes.append((term.jacobian(step) - term.jacobian(-step)) / (2 * _STEP))
        dJ = np.stack(changes, axis=-1)
        weight = np.einsum("nmik,ij,nmjl->kl", dJ, W, dJ, optimize=True)
        return np.asarray(weight / np.einsum("nmi,ij,nmj->", J, W, J, optimize=True))

    def choose(
        self,
        q: Float[np.ndarray, "candidates p"],
        A: Float[np.ndarray, "free free"],
        count: int,
        aim: Aim,
        apart: float,
        exchange: bool,
    ) -> tuple[Int[np.ndarray, "count"], Float[np.ndarray, "after"]]:
        """Which candidates to take, those that tell most first; and the predicted error before and after each.

        Chosen one by one, then exchanged, each for a candidate that is better beside all others, as long as any is
        (Fedorov 1972): the best beside those before it need not be among the best of all together.

        Args:
            q: Candidates, all of them in view.
            A: How much the error asked for changes with the measures, of :meth:`importance`.
            count: How many to take.
            aim: What they are to tell.
            apart: Least distance of any two in their farthest joint [rad or m].
            exchange: Whether they are exchanged.

        Raises:
            InvalidConfig: Too few candidates that are so far apart.
        """
        D = self.slopes(q)
        chosen = self._one_by_one(q, D, A, count, aim, apart)
        if exchange and aim != "random" and 1 < count < len(q):
            chosen = self._exchanged(chosen, q, D, A, aim, apart)
            chosen = chosen[self._one_by_one(q[chosen], D[chosen], A, count, aim, apart)]
        precision, errors = self.precision, [self._predicted(self.precision, A)]
        for one in D[chosen]:
            precision = precision + one.T @ one
            errors.append(self._predicted(precision, A))
        return chosen, np.array(errors)

    def _one_by_one(
        self,
        q: Float[np.ndarray, "candidates p"],
        D: Float[np.ndarray, "candidates m free"],
        A: Float[np.ndarray, "free free"],
        count: int,
        aim: Aim,
        apart: float,
    ) -> Int[np.ndarray, "count"]:
        """Each the best beside those before it; at random, in the order of the candidates."""
        precision = self.precision
        left = np.ones(len(q), dtype=bool)
        chosen: list[int] = []
        for number in range(count):
            here = np.flatnonzero(left)
            if not len(here):
                raise InvalidConfig(
                    f"count={count}: only {number} candidates in reach and in view are farther apart than {apart:g}; "
                    "give more of them"
                )
            best = int(here[0] if aim == "random" else here[self._worth(precision, D[here], A, aim).argmax()])
            precision = precision + D[best].T @ D[best]
            chosen.append(best)
            left &= _far(q, q[best], apart)
            left[best] = False
        return np.array(chosen)

    def _exchanged(
        self,
        chosen: Int[np.ndarray, "count"],
        q: Float[np.ndarray, "candidates p"],
        D: Float[np.ndarray, "candidates m free"],
        A: Float[np.ndarray, "free free"],
        aim: Aim,
        apart: float,
    ) -> Int[np.ndarray, "count"]:
        """The same with each exchanged for the best beside all others, round after round, until none is worth it."""
        chosen = chosen.copy()
        far = np.stack([_far(q, q[one], apart) for one in chosen])
        far[np.arange(len(chosen)), chosen] = False
        for _ in range(_ROUNDS):
            before = chosen.copy()
            for index, old in enumerate(before):
                rest = np.delete(np.arange(len(chosen)), index)
                others = D[chosen[rest]].reshape(-1, D.shape[2])
                here = np.flatnonzero(far[rest].all(0))
                worth = self._worth(self.precision + others.T @ others, D[here], A, aim)
                if worth.max() > worth[here == old][0] + _EXCHANGE:
                    new = chosen[index] = here[worth.argmax()]
                    far[index] = _far(q, q[new], apart)
                    far[index, new] = False
            if (chosen == before).all():
                break
        return chosen

    def _worth(
        self,
        precision: Float[np.ndarray, "free free"],
        D: Float[np.ndarray, "candidates m free"],
        A: Float[np.ndarray, "free free"],
        aim: Aim,
    ) -> Float[np.ndarray, "candidates"]:
        """Of each candidate beside what is known: less the logarithm of the squared error that it leaves, or of all."""
        S = self._covariance(precision)
        DS = D @ S
        inner = np.eye(D.shape[1]) + DS @ D.transpose(0, 2, 1)
        if aim == "everything":
            return np.asarray(np.linalg.slogdet(inner)[1])
        gain = np.trace(np.linalg.solve(inner, DS @ A @ DS.transpose(0, 2, 1)), axis1=1, axis2=2)
        return np.asarray(-np.log(np.maximum(np.trace(A @ S) - gain, np.finfo(float).tiny)))

    def _predicted(self, precision: Float[np.ndarray, "free free"], A: Float[np.ndarray, "free free"]) -> float:
        return float(np.sqrt(max(np.trace(A @ self._covariance(precision)), 0.0)))

    def _covariance(self, precision: Float[np.ndarray, "free free"]) -> Float[np.ndarray, "free free"]:
        # In units of the prior, so that radians and metres are inverted alike. The prior alone makes no value of the
        # precision less than one; what was seen without noise makes others so large that rounding would take them
        # below zero.
        scale = np.outer(self.sds, self.sds)
        values, vectors = np.linalg.eigh(precision * scale)
        return np.asarray((vectors / np.maximum(values, 1.0)) @ vectors.T * scale)

    def _at(self, q: Float[np.ndarray, "count p"]) -> Images:
        """What these postures would show."""
        image = np.zeros((len(q), self.images.image.shape[1]))
        return replace(self.images, q=q, offset=np.broadcast_to(self.offset, (len(q), 3)), image=image)


def _far(
    q: Float[np.ndarray, "candidates p"], one: Float[np.ndarray, "p"], apart: float
) -> Bool[np.ndarray, "candidates"]:
    """Which candidates are farther than that from one of them in their farthest joint."""
    return np.asarray(np.abs(q - one).max(axis=1) > apart)
