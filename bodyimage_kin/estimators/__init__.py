"""Estimators: frozen specs that learn a Jacobian from an experience. One family a file."""

from __future__ import annotations

from bodyimage_kin.estimators import nulls
from bodyimage_kin.estimators._samples import Pairs, edges, fold_of_each, pairs
from bodyimage_kin.estimators.analytic import Analytic, Nominal
from bodyimage_kin.estimators.base import (
    Drawn,
    Estimator,
    HasDisplacement,
    Learned,
    LearnedImage,
    LearnedJacobian,
    Uncertain,
    load_learned,
)
from bodyimage_kin.estimators.basis_ridge import BasisImage, BasisProcess, Polynomial, TrigRidge
from bodyimage_kin.estimators.conformal import Conformal, ConformalJacobian
from bodyimage_kin.estimators.ensemble import Ensemble, EnsembleJacobian
from bodyimage_kin.estimators.gaussian_process import GaussianProcess, RadialDraw, RadialImage, RadialProcess
from bodyimage_kin.estimators.given import Given, GivenImage, GivenJacobian, Saved
from bodyimage_kin.estimators.kernel_ridge import KernelDraw, KernelImage, KernelProcess, KernelRidge
from bodyimage_kin.estimators.least_squares import ConstantJacobian, LeastSquares
from bodyimage_kin.estimators.misinformed import Misinformed
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
from bodyimage_kin.estimators.rational import RationalImage, RationalPolynomial, RationalProcess, RationalTrig
from bodyimage_kin.estimators.ridge import Ridge, RidgeJacobian
from bodyimage_kin.estimators.self_calibration import (
    BodyProcess,
    CalibratedBody,
    CalibratedChain,
    ChainProcess,
    SelfCalibration,
)

__all__ = [
    "Analytic",
    "BasisImage",
    "BasisProcess",
    "BodyProcess",
    "Broyden",
    "CalibratedBody",
    "CalibratedChain",
    "ChainProcess",
    "Conformal",
    "ConformalJacobian",
    "ConstantJacobian",
    "DisplacementNetwork",
    "Drawn",
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
    "KernelDraw",
    "KernelImage",
    "KernelProcess",
    "KernelRidge",
    "Learned",
    "LearnedImage",
    "LearnedJacobian",
    "LeastSquares",
    "LocallyWeighted",
    "Misinformed",
    "NearestNeighbours",
    "NeighbourJacobian",
    "NetworkImage",
    "NetworkJacobian",
    "Nominal",
    "Pairs",
    "PaperMLP",
    "Polynomial",
    "PostureDisplacement",
    "PostureMLP",
    "RadialDraw",
    "RadialImage",
    "RadialProcess",
    "RationalImage",
    "RationalPolynomial",
    "RationalProcess",
    "RationalTrig",
    "RecursiveLeastSquares",
    "Ridge",
    "RidgeJacobian",
    "Saved",
    "SelfCalibration",
    "TrigRidge",
    "Uncertain",
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
    Polynomial,
    RationalTrig,
    RationalPolynomial,
    KernelRidge,
    GaussianProcess,
    Broyden,
    RecursiveLeastSquares,
    Kalman,
    Ensemble,
    Conformal,
    SelfCalibration,
    Misinformed,
    Analytic,
    Nominal,
    Given,
    Saved,
)


def names() -> tuple[str, ...]:
    """Names of the estimators' classes."""
    return tuple(spec.__name__ for spec in _SPECS)
