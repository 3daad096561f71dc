"""Estimators: frozen specs that learn a Jacobian from an experience. One family a file."""

from __future__ import annotations

from bodyimage_kin.estimators import nulls
from bodyimage_kin.estimators._samples import Pairs, edges, fold_of_each, pairs
from bodyimage_kin.estimators.analytic import Analytic
from bodyimage_kin.estimators.base import (
    Estimator,
    HasDisplacement,
    Learned,
    LearnedImage,
    LearnedJacobian,
    load_learned,
)
from bodyimage_kin.estimators.ensemble import Ensemble, EnsembleJacobian
from bodyimage_kin.estimators.gaussian_process import GaussianProcess, RadialProcess, TrigProcess
from bodyimage_kin.estimators.given import Given, GivenImage, GivenJacobian, Saved
from bodyimage_kin.estimators.least_squares import ConstantJacobian, LeastSquares
from bodyimage_kin.estimators.neighbours import LocallyWeighted, NearestNeighbours, NeighbourJacobian, WeightedJacobian
from bodyimage_kin.estimators.networks import (
    ForwardNetwork,
    JacobianNetwork,
    NetworkImage,
    NetworkJacobian,
    PostureDisplacement,
    PostureMLP,
)
from bodyimage_kin.estimators.online import Broyden, Kalman, RecursiveLeastSquares
from bodyimage_kin.estimators.paper_mlp import DisplacementNetwork, PaperMLP
from bodyimage_kin.estimators.rational_trig import RationalImage, RationalTrig
from bodyimage_kin.estimators.ridge import Ridge
from bodyimage_kin.estimators.self_calibration import CalibratedChain, SelfCalibration
from bodyimage_kin.estimators.trig_ridge import TrigImage, TrigRidge

__all__ = [
    "Analytic",
    "Broyden",
    "CalibratedChain",
    "ConstantJacobian",
    "DisplacementNetwork",
    "Ensemble",
    "EnsembleJacobian",
    "Estimator",
    "ForwardNetwork",
    "GaussianProcess",
    "Given",
    "GivenImage",
    "GivenJacobian",
    "HasDisplacement",
    "JacobianNetwork",
    "Kalman",
    "Learned",
    "LearnedImage",
    "LearnedJacobian",
    "LeastSquares",
    "LocallyWeighted",
    "NearestNeighbours",
    "NeighbourJacobian",
    "NetworkImage",
    "NetworkJacobian",
    "Pairs",
    "PaperMLP",
    "PostureDisplacement",
    "PostureMLP",
    "RadialProcess",
    "RationalImage",
    "RationalTrig",
    "RecursiveLeastSquares",
    "Ridge",
    "Saved",
    "SelfCalibration",
    "TrigImage",
    "TrigProcess",
    "TrigRidge",
    "WeightedJacobian",
    "edges",
    "fold_of_each",
    "load_learned",
    "names",
    "nulls",
    "pairs",
]

_SPECS: tuple[type[Estimator], ...] = (
    LeastSquares,
    Ridge,
    PaperMLP,
    PostureMLP,
    JacobianNetwork,
    ForwardNetwork,
    NearestNeighbours,
    LocallyWeighted,
    TrigRidge,
    RationalTrig,
    GaussianProcess,
    Broyden,
    RecursiveLeastSquares,
    Kalman,
    Ensemble,
    SelfCalibration,
    Analytic,
    Given,
    Saved,
)


def names() -> tuple[str, ...]:
    """Names of the estimators' classes."""
    return tuple(spec.__name__ for spec in _SPECS)
