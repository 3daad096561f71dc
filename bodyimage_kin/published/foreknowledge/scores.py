"""What is foretold of a learned Jacobian before touching, and what an onlooker then measures, as scores of a study."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from bodyimage_kin import metrics
from bodyimage_kin.body import Embodiment
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.published.foreknowledge.arms import CalibratedArm, PerturbedArms
from bodyimage_kin.published.foreknowledge.known import Foresight, Known, Predictor
from bodyimage_kin.published.foreknowledge.predictors import (
    ExcitationDeficit,
    GaussianProcessPosterior,
    MeanPostureDistance,
)
from bodyimage_kin.recordings import Noise
from bodyimage_kin.study import Context, Score
from bodyimage_kin.study.store import padded, said

__all__ = [
    "FORESEEN",
    "FORESEEN_BY_POSTURE",
    "MEASURED",
    "MEASURED_BY_POSTURE",
    "MEASURED_TOUCHING",
    "POSTURES",
    "PREDICTORS",
    "REFUSED",
    "SCORES",
    "predictors",
]

POSTURES = 200
"""Of touching, at which Jacobians are compared."""
_ARMS = 8
_FEW_ARMS = {"RationalTrig": (2, 0)}
"""Most arms of ``perturbed_arms`` and ``perturbed_arms_rough`` where a fit costs half a second."""
PREDICTORS = (
    "posture_distance",
    "posture_distance_seen",
    "posture_distance_use",
    "excitation_deficit",
    "gaussian_process",
    "gaussian_process_radial",
    "calibrated_arm",
    "perturbed_arms",
    "perturbed_arms_rough",
)


def predictors(body: Embodiment, noise: Noise, estimator: str) -> dict[str, Predictor]:
    """The predictors that are asked of an estimator, by name; sensors' noise is declared to those that ask.

    Args:
        body: The embodiment.
        noise: Of the recordings.
        estimator: Name of the class whose error is to be foretold.
    """
    arms, rough = _FEW_ARMS.get(estimator, (_ARMS, math.ceil(_ARMS / 2)))
    declared = {"encoder_noise": noise.encoder, "image_noise": noise.image}
    found: dict[str, Predictor] = {
        "posture_distance": MeanPostureDistance(),
        "posture_distance_seen": MeanPostureDistance("seen"),
        "posture_distance_use": MeanPostureDistance("use"),
        "excitation_deficit": ExcitationDeficit(),
        "gaussian_process": GaussianProcessPosterior(),
        "gaussian_process_radial": GaussianProcessPosterior("radial"),
        "calibrated_arm": CalibratedArm(body),
        "perturbed_arms": PerturbedArms(body, arms, **declared),
    }
    if rough:
        found["perturbed_arms_rough"] = PerturbedArms(body, rough, axis_spread=0.2, offset_spread=0.02, **declared)
    return found


@dataclass(frozen=True, eq=False)
class _Foretold:
    """What predictors say of one row: their foresight, and why those that refused said nothing."""

    known: Known
    said: dict[str, Foresight]
    refused: dict[str, str]


# The scores of one row are computed one after the other.
@lru_cache(maxsize=1)
def _foretold(context: Context) -> _Foretold:
    """Lets every predictor speak, from the experience and the joints felt while touching alone."""
    assert context.body is not None
    known = Known.of(
        context.experience, context.felt_use["q"].values, context.estimator, context.seed, POSTURES, context.learned
    )
    noise = context.simulation.noise if context.simulation is not None else None
    foreseen: dict[str, Foresight] = {}
    refused: dict[str, str] = {}
    for name, predictor in predictors(context.body, noise or Noise(), type(context.estimator).__name__).items():
        try:
            foreseen[name] = predictor.foresee(known)
        except BodyImageKinError as problem:
            # One that refuses is missing, and the others speak.
            refused[name] = said(problem)
    return _Foretold(known, foreseen, refused)


def _foreseen(context: Context) -> Any:
    found = _foretold(context).said
    return np.array([found[name].error if name in found else np.nan for name in PREDICTORS])


def _foreseen_by_posture(context: Context) -> Any:
    found = _foretold(context)
    silent = np.full(len(found.known.postures), np.nan)
    rows = []
    for name in PREDICTORS:
        by_posture = found.said[name].by_posture if name in found.said else None
        rows.append(silent if by_posture is None else by_posture)
    return padded(rows)


def _refused(context: Context) -> Any:
    return np.array([_foretold(context).refused.get(name, "") for name in PREDICTORS], dtype=str)


def _measured_while_touching(context: Context) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True and learned Jacobians at the true postures of touching that predictors were asked of, and the metric."""
    assert context.body is not None
    assert context.use is not None
    true_q = context.use["true_q"].values.reshape(-1, context.body.p)
    q = torch.from_numpy(true_q[_foretold(context).known.samples])
    with torch.no_grad():
        J, Jh = context.body.hand_image_jacobian(q).numpy(), context.learned.jacobian(q).detach().numpy()
    return J, Jh, metrics.motion_metric(context.use, "true")


def _measured(context: Context) -> Any:
    assert context.use is not None
    J, Jh = context.true_jacobians["on_face"], context.learned_jacobians["on_face"]
    return metrics.pooled_relative_error(J, Jh, metrics.motion_metric(context.use, "true"))


_NEEDS = ("body", "learned", "use", "true_use")
_LABELS = {"predictor": PREDICTORS}
MEASURED = Score("measured", (), "relative error on the face, true touch motion's metric", _measured, needs=_NEEDS)
MEASURED_TOUCHING = Score(
    "measured_touching", (), "the same at the postures of the touch motion",
    lambda context: metrics.pooled_relative_error(*_measured_while_touching(context)), needs=_NEEDS,
)  # fmt: skip
MEASURED_BY_POSTURE = Score(
    "measured_by_posture", ("touching",), "the same at each of them",
    lambda context: metrics.relative_error(*_measured_while_touching(context)), needs=_NEEDS,
)  # fmt: skip
FORESEEN = Score("foreseen", ("predictor",), "what is foretold of the error", _foreseen, needs=_NEEDS, labels=_LABELS)
FORESEEN_BY_POSTURE = Score(
    "foreseen_by_posture", ("predictor", "touching"), "the same of each posture of touching", _foreseen_by_posture,
    needs=_NEEDS, labels=_LABELS,
)  # fmt: skip
REFUSED = Score(
    "refused", ("predictor",), "why a predictor said nothing", _refused, needs=_NEEDS, labels=_LABELS, ratio=False
)
SCORES = (MEASURED, MEASURED_TOUCHING, MEASURED_BY_POSTURE, FORESEEN, FORESEEN_BY_POSTURE, REFUSED)
"""What is foretold is asked before anything is measured."""
