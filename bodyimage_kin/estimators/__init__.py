"""Estimators: frozen specs that learn a Jacobian from an experience. One family a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from bodyimage_kin._named import named_class
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.estimators import nulls as nulls
from bodyimage_kin.estimators.analytic import Analytic as Analytic
from bodyimage_kin.estimators.base import Estimator as Estimator
from bodyimage_kin.estimators.base import LearnedJacobian as LearnedJacobian
from bodyimage_kin.estimators.base import Pairs as Pairs
from bodyimage_kin.estimators.base import load_arrays
from bodyimage_kin.estimators.base import pairs as pairs
from bodyimage_kin.estimators.ensemble import Ensemble as Ensemble
from bodyimage_kin.estimators.ensemble import EnsembleJacobian as EnsembleJacobian
from bodyimage_kin.estimators.gaussian_process import GaussianProcess as GaussianProcess
from bodyimage_kin.estimators.gaussian_process import RadialProcess as RadialProcess
from bodyimage_kin.estimators.gaussian_process import TrigProcess as TrigProcess
from bodyimage_kin.estimators.least_squares import ConstantJacobian as ConstantJacobian
from bodyimage_kin.estimators.least_squares import LeastSquares as LeastSquares
from bodyimage_kin.estimators.neighbours import LocallyWeighted as LocallyWeighted
from bodyimage_kin.estimators.neighbours import NearestNeighbours as NearestNeighbours
from bodyimage_kin.estimators.neighbours import NeighbourJacobian as NeighbourJacobian
from bodyimage_kin.estimators.neighbours import WeightedJacobian as WeightedJacobian
from bodyimage_kin.estimators.networks import ForwardNetwork as ForwardNetwork
from bodyimage_kin.estimators.networks import JacobianNetwork as JacobianNetwork
from bodyimage_kin.estimators.networks import NetworkImage as NetworkImage
from bodyimage_kin.estimators.networks import NetworkJacobian as NetworkJacobian
from bodyimage_kin.estimators.networks import PostureDisplacement as PostureDisplacement
from bodyimage_kin.estimators.networks import PostureMLP as PostureMLP
from bodyimage_kin.estimators.online import Broyden as Broyden
from bodyimage_kin.estimators.online import Kalman as Kalman
from bodyimage_kin.estimators.online import RecursiveLeastSquares as RecursiveLeastSquares
from bodyimage_kin.estimators.paper_mlp import DisplacementNetwork as DisplacementNetwork
from bodyimage_kin.estimators.paper_mlp import PaperMLP as PaperMLP
from bodyimage_kin.estimators.rational_trig import RationalImage as RationalImage
from bodyimage_kin.estimators.rational_trig import RationalTrig as RationalTrig
from bodyimage_kin.estimators.ridge import Ridge as Ridge
from bodyimage_kin.estimators.self_calibration import CalibratedChain as CalibratedChain
from bodyimage_kin.estimators.self_calibration import SelfCalibration as SelfCalibration
from bodyimage_kin.estimators.trig_ridge import TrigImage as TrigImage
from bodyimage_kin.estimators.trig_ridge import TrigRidge as TrigRidge

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
)
_LEARNED: dict[str, type[LearnedJacobian]] = {
    kind.kind: kind
    for kind in (
        ConstantJacobian,
        DisplacementNetwork,
        PostureDisplacement,
        NetworkJacobian,
        NetworkImage,
        NeighbourJacobian,
        WeightedJacobian,
        TrigImage,
        RationalImage,
        TrigProcess,
        RadialProcess,
        CalibratedChain,
        EnsembleJacobian,
    )
}


def names() -> tuple[str, ...]:
    """Names of the estimators' classes."""
    return tuple(spec.__name__ for spec in _SPECS)


def resolve(spec: Any) -> Any:
    """An estimator from an object, a name, or the place of a class.

    Args:
        spec: An object with ``fit(exp, seed)``, returned as it is; a class of such, built without arguments; one of
            :func:`names`; or ``"package.module:Class"``, which is imported.

    Raises:
        UnknownName: A name that is none of ours.
        InvalidConfig: What cannot be imported, cannot be built without arguments, or has no ``fit``.
    """
    found = _load(spec) if isinstance(spec, str) else spec
    if isinstance(found, type):
        try:
            found = found()
        except TypeError as problem:
            raise InvalidConfig(f"estimator {spec!r} cannot be built without arguments: {problem}; build it") from None
    if not callable(getattr(found, "fit", None)):
        raise InvalidConfig(f"estimator {spec!r} has no method fit(exp, seed)")
    return found


def _load(name: str) -> Any:
    """The class of this name, or at this place."""
    ours = {spec.__name__: spec for spec in _SPECS}
    if name in ours:
        return ours[name]
    if ":" not in name:
        raise UnknownName("estimator", name, (*ours, "package.module:Class"))
    return named_class("estimator", name, ("fit",))


def learned_from_arrays(kind: str, arrays: Mapping[str, Tensor]) -> LearnedJacobian:
    """The learned Jacobian of a kind, from its arrays.

    Raises:
        UnknownName: A kind that this version does not know.
        KeyError: An array is missing.
    """
    if kind not in _LEARNED:
        raise UnknownName("kind of learned Jacobian", kind, _LEARNED)
    return _LEARNED[kind].from_arrays(arrays)


def load_learned(folder: str | os.PathLike[str]) -> LearnedJacobian:
    """A learned Jacobian that ``learned.save(folder)`` wrote.

    Raises:
        InvalidConfig: The folder holds none, or one with arrays missing.
        UnknownName: One of a kind that this version does not know.
    """
    kind, arrays = load_arrays(folder)
    try:
        return learned_from_arrays(kind, arrays)
    except KeyError as missing:
        raise InvalidConfig(f"the learned Jacobian in '{folder}' lacks the array {missing}") from None
