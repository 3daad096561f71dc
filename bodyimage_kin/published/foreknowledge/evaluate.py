"""What foretold errors are worth: predicted against measured, always out of sample.

A prediction counts only for a condition that it was not calibrated on. The calibration is ``log measured = a + b log
predicted`` (for a combination, one b each), fitted by least squares to the recordings of all other conditions.

Whoever is silent on a whole condition that was measured has no score: R2 over fewer conditions is another quantity.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.stats
from jaxtyping import Bool, Float

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin.errors import InvalidArray, InvalidConfig, UnknownName
from bodyimage_kin.study.statistics import Interval, resampled_together

__all__ = [
    "Combination",
    "Errors",
    "Groups",
    "PostureScore",
    "Score",
    "evaluate",
    "evaluate_by_posture",
    "leave_one_condition_out",
    "r2",
    "slope",
]

Errors: TypeAlias = ArrayLike
"""(conditions, recordings) positive floats; not finite where a recording failed."""
Groups: TypeAlias = Sequence[object] | np.ndarray | None
"""Label of each condition; None: each has its own."""


@dataclass(frozen=True)
class Combination:
    """Several predictors in one: a linear combination of the logarithms of what they foretell.

    Attributes:
        of: Names of the predictors.
        penalty: On the squared weights of the standardised logarithms (ridge), relative to the mean squared error; the
            intercept is free. Fixed beforehand, not tuned.
    """

    of: tuple[str, ...]
    penalty: float = 0.01

    def __post_init__(self) -> None:
        if not self.of or len(set(self.of)) != len(self.of):
            raise InvalidConfig(f"of={self.of!r}: give names of predictors, each once")
        if not 0 <= self.penalty < np.inf:
            raise InvalidConfig(f"penalty={self.penalty!r}: give a number of at least 0")


@dataclass(frozen=True, eq=False)
class Score:
    """What a predictor is worth for one estimator; NaN unless it spoke of every condition that was measured.

    Attributes:
        r2: R2 of the conditions' mean errors, out of sample, and its interval over conditions.
        r2_log: The same of the logarithms.
        r2_recordings: The same of single recordings.
        slope: Calibration slope: of the regression of measured on out-of-sample predicted means of conditions. 1 is
            calibrated, below 1 the predictions are spread too far.
        raw_r2: R2 of the conditions' means without any calibration; NaN for a predictor that is not absolute.
        raw_slope: Slope of measured on what was foretold without calibration; likewise.
        predicted: (conditions, recordings) out of sample.
    """

    r2: Interval
    r2_log: float
    r2_recordings: float
    slope: Interval
    raw_r2: float
    raw_slope: float
    predicted: Float[np.ndarray, "conditions recordings"]


@dataclass(frozen=True)
class PostureScore:
    """What a predictor says of postures within a recording, averaged over recordings; NaN as in :class:`Score`.

    Attributes:
        rank_correlation: Spearman's.
        r2: R2 of the calibrated errors of postures; the calibration is that of all postures of all other conditions.
    """

    rank_correlation: float
    r2: float


def r2(measured: ArrayLike, predicted: ArrayLike) -> float:
    """``1 - sum (measured - predicted)^2 / sum (measured - mean)^2``; NaN where nothing varies.

    Args:
        measured: Floats of any shape.
        predicted: Of the same shape. Pairs that are not finite are left out.

    Returns:
        1 for a perfect prediction, 0 for one no better than the mean of all measured, which nobody knows beforehand.

    Raises:
        InvalidArray: Shapes that differ.
    """
    y, x = _pairs(measured, predicted)
    total = float(((y - y.mean()) ** 2).sum()) if len(y) else 0.0
    return 1.0 - float(((y - x) ** 2).sum()) / total if total > 0 else float("nan")


def slope(measured: ArrayLike, predicted: ArrayLike) -> float:
    """Slope of the least-squares line of measured on predicted; NaN where nothing varies. Arguments as in :func:`r2`.

    Raises:
        InvalidArray: Shapes that differ.
    """
    y, x = _pairs(measured, predicted)
    away = x - x.mean() if len(x) else x
    spread = float(away @ away)
    return float(away @ (y - y.mean())) / spread if spread > 1e-24 * float(x @ x) else float("nan")


def leave_one_condition_out(
    measured: Errors,
    predicted: ArrayLike,
    penalty: float | int = 0.0,
    groups: Groups = None,
) -> Float[np.ndarray, "conditions *rest"]:
    """Predictions of each condition, calibrated on all others.

    Args:
        measured: (conditions, *rest) positive errors.
        predicted: (predictors, conditions, *rest) positive; what is not finite and positive teaches nothing.
        penalty: As in :class:`Combination`.
        groups: Label of each condition: those of one label are left out together; None: each alone.

    Returns:
        Predicted errors; NaN where a predictor said nothing.

    Raises:
        InvalidArray: Shapes that do not fit together, or fewer than three conditions.
    """
    y, x = as_float_array(measured, "measured", ndim=2), as_float_array(predicted, "predicted", ndim=3)
    if x.shape[1:] != y.shape:
        raise InvalidArray(f"measured has shape {y.shape} but predicted {x.shape}; give (predictors, *{y.shape})")
    labels = np.arange(len(y)) if groups is None else np.asarray(groups)
    if labels.shape != (len(y),):
        raise InvalidArray(f"groups has shape {labels.shape}; give one label for each of {len(y)} conditions")
    if len(y) < 3 or len(np.unique(labels)) < 2:
        raise InvalidArray(
            f"{len(y)} conditions in {len(np.unique(labels))} groups leave too few to learn a calibration from; give "
            "at least 3, in at least 2 groups"
        )
    with np.errstate(all="ignore"):
        y, x = np.log(y), np.log(x)
    usable = np.isfinite(y) & np.isfinite(x).all(0)
    found = np.full(y.shape, np.nan)
    for label in np.unique(labels):
        out = labels == label
        others = usable & ~out.reshape(-1, *[1] * (y.ndim - 1))
        if others.any():
            found[out] = np.exp(_line(x[:, others], y[others], float(penalty))(x[:, out]))
    return found


def evaluate(
    measured: Errors,
    predicted: Mapping[str, Errors],
    combinations: Mapping[str, Combination] | None = None,
    *,
    absolute: Collection[str] = (),
    groups: Groups = None,
    resamples: int = 500,
) -> dict[str, Score]:
    """Scores predictors of one estimator's error against what was measured, one whole condition out at a time.

    Args:
        measured: (conditions, recordings) errors; recording i of all conditions is of one seed.
        predicted: Predictor -> what it foretold of them.
        combinations: Name -> combination of them.
        absolute: Names of predictors that foretell the error itself.
        groups: As in :func:`leave_one_condition_out`.
        resamples: Bootstrap samples of the conditions, each calibrated anew and copies of one left out together; the
            interval is of their percentiles, NaN with too few conditions to publish one
            (:data:`bodyimage_kin.study.statistics.NEEDED`): more recordings of the same conditions make no R2 surer.

    Returns:
        Name -> score, combinations last, and ``"mean_of_others"``: the geometric mean error of the other conditions'
        recordings (the calibration's intercept alone), which anybody can foretell, and whose R2 is negative.

    Raises:
        InvalidArray: Shapes that differ, or fewer than three conditions.
        UnknownName: A combination of predictors that are not there.
    """
    y = as_float_array(measured, "measured", ndim=2)
    features = {}
    for name, values in predicted.items():
        features[name] = as_float_array(values, f"predicted of {name!r}", ndim=2)
        if features[name].shape != y.shape:
            raise InvalidArray(f"predicted of {name!r} has shape {features[name].shape} but measured {y.shape}")
    recipes = {name: Combination((name,), 0.0) for name in features} | dict(combinations or {})
    for recipe in recipes.values():
        for name in recipe.of:
            if name not in features:
                raise UnknownName("predictor", name, features)
    found = {}
    for name, recipe in recipes.items():
        x = np.stack([features[one] for one in recipe.of])
        raw = features.get(name) if name in absolute else None
        found[name] = _score(y, x, recipe.penalty, groups, raw, resamples)
    found["mean_of_others"] = _score(y, np.ones((1, *y.shape)), 0.0, groups, None, 0)
    return found


def evaluate_by_posture(measured: ArrayLike, predicted: ArrayLike) -> PostureScore:
    """How well errors of single postures are foretold within a recording.

    Args:
        measured: (conditions, recordings, postures) errors.
        predicted: The same of what was foretold.

    Raises:
        InvalidArray: As in :func:`leave_one_condition_out`.
    """
    y = as_float_array(measured, "measured", ndim=3)
    x = as_float_array(predicted, "predicted", ndim=3)
    calibrated = leave_one_condition_out(y, x[None])
    if _silent(y, calibrated):
        return PostureScore(float("nan"), float("nan"))
    ranks, explained = [], []
    for one, raw, best in zip(*(a.reshape(-1, a.shape[-1]) for a in (y, x, calibrated)), strict=True):
        there = np.isfinite(one) & np.isfinite(best)
        if there.any() and np.ptp(raw[there]) > 0 and np.ptp(one[there]) > 0:
            ranks.append(float(scipy.stats.spearmanr(one[there], raw[there]).statistic))
            explained.append(r2(one, best))
    if not ranks:
        return PostureScore(float("nan"), float("nan"))
    return PostureScore(float(np.mean(ranks)), float(np.mean(explained)))


# Inner ---------------------------------------------------------------------------------------------------------------


def _pairs(measured: ArrayLike, predicted: ArrayLike) -> tuple[Float[np.ndarray, "pairs"], Float[np.ndarray, "pairs"]]:
    y, x = as_float_array(measured, "measured"), as_float_array(predicted, "predicted")
    if y.shape != x.shape:
        raise InvalidArray(f"measured has shape {y.shape} but predicted {x.shape}; they must be the same")
    there: Bool[np.ndarray, "..."] = np.isfinite(y) & np.isfinite(x)
    return y[there], x[there]


def _silent(y: Float[np.ndarray, "conditions *rest"], x: Float[np.ndarray, "conditions *rest"]) -> bool:
    """Whether nothing was foretold of a whole condition that was measured."""
    rest = tuple(range(1, y.ndim))
    measured = np.isfinite(y)
    return bool((measured.any(rest) & ~(measured & np.isfinite(x)).any(rest)).any())


def _line(x: Float[np.ndarray, "k rows"], y: Float[np.ndarray, "rows"], penalty: float) -> Any:
    """The regression of y on x, as a function of new x; what does not vary has no weight."""
    middle, spread = x.mean(1), x.std(1)
    unit = np.where(spread > 1e-12 * np.maximum(1.0, np.abs(middle)), spread, np.inf)
    z = (x - middle[:, None]) / unit[:, None]
    gram = z @ z.T / len(y) + penalty * np.eye(len(x))
    weights = np.linalg.lstsq(gram, z @ (y - y.mean()) / len(y), rcond=1e-12)[0] / unit
    return lambda new: y.mean() + np.tensordot(weights, new - middle.reshape(-1, *[1] * (new.ndim - 1)), 1)


def _score(
    y: Float[np.ndarray, "conditions recordings"],
    x: Float[np.ndarray, "k conditions recordings"],
    penalty: float,
    groups: Groups,
    raw: Float[np.ndarray, "conditions recordings"] | None,
    resamples: int,
) -> Score:
    predicted = leave_one_condition_out(y, x, penalty, groups)
    labels = np.unique(np.arange(len(y)) if groups is None else np.asarray(groups), return_inverse=True)[1]
    nothing = (float("nan"), float("nan"))

    def of(units: np.ndarray) -> tuple[float, float]:
        """R2 and slope of some conditions, calibrated anew; copies of one are left out together."""
        if len(np.unique(units)) < 3:
            return nothing
        again = leave_one_condition_out(y[units], x[:, units], penalty, labels[units])
        return _both(*_means(y[units], again))

    explained, line = resampled_together(of, len(y), "conditions", resamples=resamples)
    return Score(
        r2=explained,
        r2_log=r2(*map(np.log, _means(y, predicted))),
        r2_recordings=float("nan") if _silent(y, predicted) else r2(y, predicted),
        slope=line,
        **dict(zip(("raw_r2", "raw_slope"), nothing if raw is None else _both(*_means(y, raw)), strict=True)),
        predicted=predicted,
    )


def _both(y: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    return r2(y, x), slope(y, x)


def _means(y: np.ndarray, x: np.ndarray) -> tuple[Float[np.ndarray, "conditions"], Float[np.ndarray, "conditions"]]:
    """Means over the recordings of which both are known; NaN for a condition without, and for all if one is silent."""
    there = np.isfinite(y) & np.isfinite(x) & (not _silent(y, x))
    count = np.where(there.any(1), there.sum(1), np.nan)
    return np.where(there, y, 0.0).sum(1) / count, np.where(there, x, 0.0).sum(1) / count
