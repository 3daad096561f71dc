"""Estimators: frozen specs that learn a Jacobian from an experience. One family a file."""

from __future__ import annotations

import os

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.estimators.analytic import Analytic as Analytic
from bodyimage_kin.estimators.base import Estimator as Estimator
from bodyimage_kin.estimators.base import LearnedJacobian as LearnedJacobian
from bodyimage_kin.estimators.base import Pairs as Pairs
from bodyimage_kin.estimators.base import load_arrays
from bodyimage_kin.estimators.base import pairs as pairs
from bodyimage_kin.estimators.least_squares import ConstantJacobian as ConstantJacobian
from bodyimage_kin.estimators.least_squares import LeastSquares as LeastSquares
from bodyimage_kin.estimators.paper_mlp import DisplacementNetwork as DisplacementNetwork
from bodyimage_kin.estimators.paper_mlp import PaperMLP as PaperMLP
from bodyimage_kin.estimators.rational_trig import RationalImage as RationalImage
from bodyimage_kin.estimators.rational_trig import RationalTrig as RationalTrig
from bodyimage_kin.estimators.ridge import Ridge as Ridge
from bodyimage_kin.estimators.trig_ridge import TrigImage as TrigImage
from bodyimage_kin.estimators.trig_ridge import TrigRidge as TrigRidge

_SPECS: tuple[type[Estimator], ...] = (LeastSquares, Ridge, PaperMLP, TrigRidge, RationalTrig, Analytic)
_LEARNED: dict[str, type[LearnedJacobian]] = {
    kind.kind: kind for kind in (ConstantJacobian, DisplacementNetwork, TrigImage, RationalImage)
}


def names() -> tuple[str, ...]:
    """Names of the estimators' classes."""
    return tuple(spec.__name__ for spec in _SPECS)


def load_learned(folder: str | os.PathLike[str]) -> LearnedJacobian:
    """A learned Jacobian that ``learned.save(folder)`` wrote.

    Raises:
        InvalidConfig: The folder holds none, or one with arrays missing.
        UnknownName: One of a kind that this version does not know.
    """
    kind, arrays = load_arrays(folder)
    if kind not in _LEARNED:
        raise UnknownName("kind of learned Jacobian", kind, _LEARNED)
    try:
        return _LEARNED[kind].from_arrays(arrays)
    except KeyError as missing:
        raise InvalidConfig(f"the learned Jacobian in '{folder}' lacks the array {missing}") from None
