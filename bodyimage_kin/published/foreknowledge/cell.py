"""One condition and seed: what is foretold of each estimator, and what an onlooker then measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import _checks, metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.estimators import Estimator, LeastSquares, PaperMLP, RationalTrig
from bodyimage_kin.published.foreknowledge.arms import CalibratedArm, PerturbedArms
from bodyimage_kin.published.foreknowledge.conditions import Condition
from bodyimage_kin.published.foreknowledge.evaluate import Combination
from bodyimage_kin.published.foreknowledge.known import Foresight, Known, Predictor
from bodyimage_kin.published.foreknowledge.predictors import (
    ExcitationDeficit,
    GaussianProcessPosterior,
    MeanPostureDistance,
)
from bodyimage_kin.study import store

ESTIMATORS: Mapping[str, Estimator] = {
    "least_squares": LeastSquares(),
    "paper_mlp": PaperMLP(hidden=10, learning_rate=0.2, steps=500),
    "rational_trig": RationalTrig(),
}
"""Whose errors are foretold: a constant, the paper's network, and one that models depth."""
COMBINATIONS: Mapping[str, Combination] = {
    "without_structure": Combination(("posture_distance", "excitation_deficit", "gaussian_process")),
    "with_structure": Combination(("posture_distance", "gaussian_process", "perturbed_arms")),
}
_ARMS = {"rational_trig": (2, 0)}
"""Most arms of ``perturbed_arms`` and ``perturbed_arms_rough`` where a fit costs half a second."""
_ARM_PREDICTORS = ("perturbed_arms", "perturbed_arms_rough")


@dataclass(frozen=True)
class Settings:
    """What a run is asked for.

    Attributes:
        embodiment: Name, or path of a TOML file.
        seeds: Number of recordings of each condition.
        touch_duration: How long the face is touched [s].
        arms: Perturbed arms for each recording, half as many rough ones; the estimator that is slow to fit has two and
            none.
        postures: Postures of touching at which Jacobians are compared.
        backend: Kinematics backend; None: the default.
    """

    embodiment: str = "infant"
    seeds: int = 30
    touch_duration: float = 80.0
    arms: int = 8
    postures: int = 200
    backend: str | None = None

    def __post_init__(self) -> None:
        for field in ("seeds", "arms", "postures"):
            _checks.whole(field, getattr(self, field), least=1)


@dataclass(frozen=True, eq=False)
class Cell:
    """What came of one condition and seed. Errors are relative, in the touch motion's metric.

    Attributes:
        measured: (estimators,) at the postures that touch each taxel once: the headline.
        measured_touching: (estimators,) at the true postures of the touch motion.
        measured_by_posture: (estimators, postures) at each of these.
        foreseen: (predictors, estimators); NaN where a predictor refused or was not asked.
        foreseen_by_posture: (predictors, estimators, postures); NaN where it cannot tell.
        refused: Estimator -> predictor -> why it said nothing, in one line; without those that spoke.
    """

    measured: Float[np.ndarray, "estimators"]
    measured_touching: Float[np.ndarray, "estimators"]
    measured_by_posture: Float[np.ndarray, "estimators postures"]
    foreseen: Float[np.ndarray, "predictors estimators"]
    foreseen_by_posture: Float[np.ndarray, "predictors estimators postures"]
    refused: Mapping[str, Mapping[str, str]]


@dataclass(frozen=True)
class Failed:
    """A condition and seed of which nothing came.

    Attributes:
        words: Why, in one line.
    """

    words: str


def predictors(settings: Settings, body: Embodiment, condition: Condition, estimator: str) -> dict[str, Predictor]:
    """The predictors of a run that are asked of an estimator, by name; sensors' noise is declared to those that ask."""
    arms, rough = _ARMS.get(estimator, (settings.arms, math.ceil(settings.arms / 2)))
    noise = {"encoder_noise": condition.encoder_noise, "image_noise": condition.image_noise}
    found: dict[str, Predictor] = {
        "posture_distance": MeanPostureDistance(),
        "posture_distance_seen": MeanPostureDistance("seen"),
        "posture_distance_use": MeanPostureDistance("use"),
        "excitation_deficit": ExcitationDeficit(),
        "gaussian_process": GaussianProcessPosterior(),
        "gaussian_process_radial": GaussianProcessPosterior("radial"),
        "calibrated_arm": CalibratedArm(body),
        "perturbed_arms": PerturbedArms(body, min(arms, settings.arms), **noise),
    }
    if rough:
        found["perturbed_arms_rough"] = PerturbedArms(body, rough, axis_spread=0.2, offset_spread=0.02, **noise)
    return found


def run_cell(settings: Settings, condition: Condition, seed: int) -> Cell:
    """Simulates, lets every predictor speak of every estimator, and only then looks at the truth."""
    torch.set_num_threads(1)
    body = load_embodiment(settings.embodiment, settings.backend)
    circle, touch = condition.circle(body, seed), _touch(settings, body.sha256, _moved(condition), seed)
    known = Known.of(circle, touch["q"].values, next(iter(ESTIMATORS.values())), seed, settings.postures)
    of = {name: known.about(spec) for name, spec in ESTIMATORS.items()}
    # One set of predictors for all estimators where they do not differ, so that a shared arm is calibrated once.
    shared = predictors(settings, body, condition, "")
    said: dict[str, dict[str, Foresight]] = {name: {} for name in of}
    refused: dict[str, dict[str, str]] = {name: {} for name in of}
    for name, about in of.items():
        for predictor, own in predictors(settings, body, condition, name).items():
            try:
                said[name][predictor] = (own if predictor in _ARM_PREDICTORS else shared[predictor]).foresee(about)
            except BodyImageKinError as problem:
                # One that refuses is missing, and the run goes on.
                refused[name][predictor] = store.said(problem)
    measured = {name: _measure(body, about, touch["true_q"].values) for name, about in of.items()}
    silent, nothing = np.full(len(known.postures), np.nan), Foresight(float("nan"), None)
    return Cell(
        measured=np.array([one[0] for one in measured.values()]),
        measured_touching=np.array([one[1] for one in measured.values()]),
        measured_by_posture=np.stack([one[2] for one in measured.values()]),
        foreseen=np.array([[said[name].get(predictor, nothing).error for name in of] for predictor in shared]),
        foreseen_by_posture=np.stack(
            [[_or(said[name].get(predictor, nothing).by_posture, silent) for name in of] for predictor in shared]
        ),
        refused=refused,
    )


def try_cell(settings: Settings, condition: Condition, seed: int) -> Cell | Failed:
    """As :func:`run_cell`; or says what went wrong."""
    try:
        return run_cell(settings, condition, seed)
    except Exception as problem:
        # Said in words: not every error can travel from a worker.
        return Failed(store.said(problem))


def _moved(condition: Condition) -> Condition:
    """A condition without what the touch motion does not depend on."""
    return replace(condition, name="", family="", distances=(), radius=0.0, turns=0.0)


@lru_cache(maxsize=4)
def _touch(settings: Settings, sha256: str, condition: Condition, seed: int) -> xr.Dataset:
    """The touch motion, simulated once for the conditions of a seed that share it. The hash tells bodies apart."""
    return condition.touch(load_embodiment(settings.embodiment, settings.backend), seed, settings.touch_duration)


def _or(values: np.ndarray | None, otherwise: np.ndarray) -> np.ndarray:
    return otherwise if values is None else values


def _measure(
    body: Embodiment, known: Known, true_q: Float[np.ndarray, "trial time p"]
) -> tuple[float, float, Float[np.ndarray, "postures"]]:
    """The error on the face, over the touch motion, and at each of its postures that predictors were asked of."""
    metric = metrics.motion_metric(np.diff(true_q, axis=1), "true")
    touching = torch.from_numpy(true_q.reshape(-1, body.p)[known.samples])
    face = body.touch_postures(np.arange(body.require_skin().count))
    pairs = [
        (body.hand_image_jacobian(q).detach().numpy(), known.learned.jacobian(q).detach().numpy())
        for q in (face, touching)
    ]
    pooled = [metrics.pooled_relative_error(J, Jh, metric) for J, Jh in pairs]
    return pooled[0], pooled[1], metrics.relative_error(*pairs[1], metric)
