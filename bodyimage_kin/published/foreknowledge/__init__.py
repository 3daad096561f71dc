"""Foreknowledge: the error on the face, foretold before the face is touched.

What a robot learned of its hand in sight is used where it cannot look. Can it know beforehand how wrong it will be
there? Predictors are given the experience and the joints felt while touching; what they say is held against the error
that only an onlooker can measure, always in conditions that they were not calibrated on. :func:`grid` is the
experiment as a study, :func:`judge` what its results say.
"""

from bodyimage_kin.published.foreknowledge.arms import CalibratedArm, PerturbedArms
from bodyimage_kin.published.foreknowledge.evaluate import (
    Combination,
    PostureScore,
    Score,
    evaluate,
    evaluate_by_posture,
    leave_one_condition_out,
    r2,
    slope,
)
from bodyimage_kin.published.foreknowledge.grid import CONDITIONS, ESTIMATORS, Condition, grid
from bodyimage_kin.published.foreknowledge.judge import (
    COMBINATIONS,
    MEAN_OF_OTHERS,
    TARGET,
    NothingCame,
    judge,
    label,
    markdown,
    verdict,
    write_summary,
)
from bodyimage_kin.published.foreknowledge.known import Foresight, Known, PlausibleTruths, Predictor
from bodyimage_kin.published.foreknowledge.predictors import (
    ExcitationDeficit,
    GaussianProcessPosterior,
    MeanPostureDistance,
)
from bodyimage_kin.published.foreknowledge.scores import PREDICTORS, predictors

__all__ = [
    "COMBINATIONS",
    "CONDITIONS",
    "ESTIMATORS",
    "MEAN_OF_OTHERS",
    "PREDICTORS",
    "TARGET",
    "CalibratedArm",
    "Combination",
    "Condition",
    "ExcitationDeficit",
    "Foresight",
    "GaussianProcessPosterior",
    "Known",
    "MeanPostureDistance",
    "NothingCame",
    "PerturbedArms",
    "PlausibleTruths",
    "PostureScore",
    "Predictor",
    "Score",
    "evaluate",
    "evaluate_by_posture",
    "grid",
    "judge",
    "label",
    "leave_one_condition_out",
    "markdown",
    "predictors",
    "r2",
    "slope",
    "verdict",
    "write_summary",
]
