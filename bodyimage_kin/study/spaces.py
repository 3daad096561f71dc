"""What is searched when an estimator is tuned, as plain tables, and settings that fill it evenly.

A space is ``{SETTING: range}``. A range is one of

========================================= ============================================================================
``{"choice": [...]}``                     each as often as any other; an item that is a range is gone through in turn
``{"uniform": [least, most]}``            whole numbers when both bounds are
``{"log_uniform": [least, most]}``        its logarithm uniform; whole numbers when both bounds are
========================================= ============================================================================
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import scipy.stats

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study.specs import Table, written

__all__ = ["SPACES", "checked_space", "points"]

_PENALTY_OR_OWN = {"choice": [None, {"log_uniform": [1e-11, 1.0]}]}
"""None: the estimator's own choice."""
_TRAINING: Table = {
    "hidden": {"choice": [[8], [16], [32], [64], [16, 16], [32, 32]]},
    "learning_rate": {"log_uniform": [1e-3, 0.1]},
    "steps": {"log_uniform": [200, 1500]},
    "weight_decay": {"log_uniform": [1e-3, 5.0]},
    "held_out": {"choice": [0.0, 0.1, 0.2, 0.3]},
}

SPACES: Mapping[str, Table] = {
    # One solution, and nothing to set: `scale` is prior knowledge.
    "LeastSquares": {},
    "Ridge": {"penalty": {"choice": [None, {"log_uniform": [1e-10, 1e-2]}]}},
    "PaperMLP": {
        "hidden": {"log_uniform": [4, 40]},
        "learning_rate": {"log_uniform": [0.02, 1.0]},
        "steps": {"log_uniform": [50, 5000]},
    },
    "PostureMLP": _TRAINING,
    "JacobianNetwork": _TRAINING,
    "ForwardNetwork": _TRAINING,
    "NearestNeighbours": {"neighbours": {"log_uniform": [5, 300]}, "penalty": {"log_uniform": [1e-5, 1.0]}},
    "LocallyWeighted": {
        "bandwidth": {"choice": [None, {"log_uniform": [0.01, 1.0]}]},
        "penalty": {"log_uniform": [1e-5, 1.0]},
    },
    "TrigRidge": {
        "degree": {"choice": [1, 2, 3, 4, 5]},
        "penalty": _PENALTY_OR_OWN,
        "roughness": {"log_uniform": [1.0, 256.0]},
    },
    "RationalTrig": {
        "degree": {"choice": [None, 1, 2, 3]},
        "penalty": _PENALTY_OR_OWN,
        "roughness": {"log_uniform": [1.0, 256.0]},
        "iterations": {"choice": [1, 2, 4]},
    },
    "Polynomial": {
        "degree": {"choice": [1, 2, 3, 4]},
        "penalty": _PENALTY_OR_OWN,
        "roughness": {"log_uniform": [1.0, 256.0]},
    },
    "RationalPolynomial": {
        "degree": {"choice": [1, 2, 3, 4]},
        "penalty": _PENALTY_OR_OWN,
        "roughness": {"log_uniform": [1.0, 256.0]},
        "iterations": {"choice": [1, 2, 4]},
    },
    "KernelRidge": {
        "kernel": {"choice": ["trigonometric", "periodic", "gaussian"]},
        "penalty": {"choice": [None, 1e-9, 1e-7, 1e-5, 1e-3, 1e-1]},
        "most": {"choice": [125, 250, 500]},
    },
    "GaussianProcess": {
        "kernel": {"choice": ["trigonometric", "radial"]},
        "degree": {"choice": [1, 2, 3, 4, 5]},
        "most": {"choice": [125, 250, 1000]},
    },
    "Broyden": {"gain": {"log_uniform": [0.01, 1.0]}, "smallest": {"log_uniform": [1e-6, 1e-2]}},
    "RecursiveLeastSquares": {
        "forgetting": {"choice": [0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 1.0]},
        "confidence": {"log_uniform": [1e2, 1e8]},
    },
    "Kalman": {
        "drift": {"log_uniform": [1e-6, 0.1]},
        "image_noise": {"log_uniform": [1e-5, 1e-2]},
        "spread": {"log_uniform": [1e-2, 1.0]},
    },
    # They take over the settings that were tuned for the estimator within.
    "Ensemble": {},
    "Conformal": {},
    "Misinformed": {},
    # The spreads are no settings but prior knowledge: how well the body is known beforehand.
    "SelfCalibration": {"robust": {"choice": [True, False]}, "steps": {"log_uniform": [20, 100]}},
    # The truth, and what was learned elsewhere.
    "Analytic": {},
    "Given": {},
    "Nominal": {},
    "Saved": {},
}
"""Class -> space. None within a choice is the setting's own None."""

_KINDS = ("choice", "uniform", "log_uniform")


def checked_space(what: str, space: Any) -> Table:
    """The space as a plain table.

    Args:
        what: Whose space it is, for errors.
        space: Setting -> range.

    Raises:
        InvalidConfig: No table of ranges; names the setting.
        UnknownName: Another kind of range.
    """
    if not isinstance(space, Mapping):
        raise InvalidConfig(f"space of {what} is {space!r}; give {{SETTING: range}}")
    found = {str(name): written(f"space of {what}: {name}", span) for name, span in space.items()}
    for name, span in found.items():
        _check(f"space of {what}: {name}", span)
    return found


def points(space: Table, count: int, seed: int = 0) -> Iterator[Table]:
    """Settings at the points of a scrambled Halton sequence (Owen 2017), which fills a space of any size evenly.

    Args:
        space: What :func:`checked_space` gave.
        count: How many; the first ones are those of fewer.
        seed: Of the scrambling.

    Yields:
        One setting of each name; floats of three digits. Of a space of few settings some come again.
    """
    # A coordinate for which item of a choice, and one for where in an item that is a range.
    ends = np.cumsum([_depth(span) for span in space.values()])
    sequence = scipy.stats.qmc.Halton(int(ends[-1]), rng=np.random.default_rng(seed))
    for _ in range(count):
        at = np.split(sequence.random(1)[0], ends[:-1])
        yield {name: _at(span, place.tolist()) for (name, span), place in zip(space.items(), at, strict=True)}


def _check(what: str, span: Any) -> None:
    if not isinstance(span, dict) or len(span) != 1:
        raise InvalidConfig(f"{what} is {span!r}; give one range, such as {{'choice': [...]}}")
    kind, values = next(iter(span.items()))
    if kind not in _KINDS:
        raise UnknownName(f"range ({what})", kind, _KINDS)
    if not isinstance(values, list) or not values:
        raise InvalidConfig(f"{what}: {kind} is {values!r}; give a list")
    if kind == "choice":
        for item in values:
            if isinstance(item, dict):
                _check(what, item)
        return
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if not numbers or len(values) != 2 or not -math.inf < values[0] <= values[1] < math.inf:
        raise InvalidConfig(f"{what}: {kind} is {values!r}; give [least, most]")
    if kind == "log_uniform" and values[0] <= 0:
        raise InvalidConfig(f"{what}: log_uniform is {values!r}; give positive bounds")


def _depth(span: Table) -> int:
    """How many coordinates say where in a range one is."""
    return 1 + max((_depth(item) for item in next(iter(span.values())) if isinstance(item, dict)), default=0)


def _at(span: Table, place: list[float]) -> Any:
    """The setting at a place, the first coordinate of those not used yet."""
    ((kind, values),) = span.items()
    share = place.pop(0)
    if kind == "choice":
        item = values[min(int(share * len(values)), len(values) - 1)]
        return _at(item, place) if isinstance(item, dict) else item
    least, most = values
    if kind == "uniform":
        found = least + share * (most - least)
    else:
        found = math.exp(math.log(least) + share * math.log(most / least))
    if isinstance(least, int) and isinstance(most, int):
        return round(found)
    return min(max(float(f"{found:.3g}"), float(least)), float(most))
