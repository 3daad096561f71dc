"""Scores without a truth: what estimators foretell of observations that they did not learn from.

Each fold of an experience is hidden in turn, whole blocks of it; errors are those of all folds together. Intervals
resample stretches of the recording, never samples, which are nearly copies of their neighbours.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int

from bodyimage_kin import _checks, metrics
from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig
from bodyimage_kin.estimators import Estimator, Learned, LearnedImage
from bodyimage_kin.metrics import HeldOut
from bodyimage_kin.recordings import experience
from bodyimage_kin.study.answers import checked
from bodyimage_kin.study.specs import plain_name
from bodyimage_kin.study.statistics import ratio_of_sums

__all__ = ["foretold", "held_out_scores", "learned_scores", "noise_of"]

_RESAMPLES = 1999
_FEWEST = 5
"""Stretches from which an interval is told."""


def held_out_scores(
    estimators: Mapping[str, Estimator],
    recording: xr.Dataset,
    *,
    folds: int = 5,
    noise: float | None = None,
    seed: int = 0,
    tell: Callable[[str], object] | None = None,
) -> xr.Dataset:
    """What each estimator foretells of postures that it did not learn from.

    Args:
        estimators: Name -> estimator; each learns once for each fold.
        recording: Of any kind, with images; what only a simulator knows is not looked at.
        folds: How many parts are hidden in turn: groups of blocks, arcs of a stream, clusters of scattered postures.
        noise: Root of the mean squared noise of one image [its unit]; None: from repeats of a posture, or unknown.
        seed: Of fits and of the resampling.
        tell: Called with the name of each estimator before it learns.

    Returns:
        Over ``estimator``: ``pair_error`` [unit] (root mean squared error of displacements between neighbouring
        postures), ``pair_error_relative`` over the root mean square of what was observed, both also without the noise
        floor (``..._corrected``); ``image_error`` and so on likewise, of estimators of the image itself;
        ``pair_error_relative_lower`` and ``_upper``, 95 % intervals over stretches of the recording; ``by_fold``
        (estimator, fold), relative pair errors; ``failure``, one line where it could not learn. Beside them the facts
        ``noise_floor`` [unit] (NaN: unknown), ``moved_share`` and ``local_spectrum`` (direction).

    Raises:
        InvalidRecording: Nothing seen, or nothing that can be held out.
        InvalidConfig: No estimator, or other arguments out of their range.
    """
    if not estimators:
        raise InvalidConfig("estimators: give at least one")
    for name in estimators:
        plain_name("estimator", name)
    exp = experience(recording)
    parts = metrics.hold_out_folds(exp, _checks.whole("folds", folds, least=2))
    floor = noise_of(exp) if noise is None else _checks.number("noise", noise, least=0.0)
    rows = {}
    for name, estimator in estimators.items():
        if tell is not None:
            tell(name)
        rows[name] = _row(estimator, parts, floor, seed)
    found = xr.Dataset(
        {key: ("estimator", np.array([one[key] for one in rows.values()])) for key in _NUMBERS}
        | {"by_fold": (("estimator", "fold"), np.stack([one["by_fold"] for one in rows.values()]))}
        | {"failure": ("estimator", np.array([one["failure"] for one in rows.values()], dtype=object))},
        {"estimator": list(rows), "fold": np.arange(len(parts))},
    )
    spectrum = _spectrum(exp)
    found["noise_floor"] = float(floor)
    found["moved_share"] = spectrum.share
    found["local_spectrum"] = ("direction", _mean_spectrum(spectrum))
    found = _with_units(found, exp)
    found.attrs |= {
        "postures": sum(len(part.q) for part in parts),
        "pairs": sum(len(part.hidden.dr) for part in parts),
        "stretches": len(np.unique(np.concatenate([part.run for part in parts]))),
    }
    return found


def learned_scores(
    learned: Learned, seen: xr.Dataset, use: xr.Dataset | None = None, noise: float | None = None
) -> xr.Dataset:
    """What a learned Jacobian says of observed displacements, no truth being known.

    Args:
        learned: What was learned.
        seen: The recording that it was learned from.
        use: Another recording with images; None, or one without: ``seen`` is foretold, which flatters.
        noise: As of :func:`held_out_scores`.

    Returns:
        ``pair_error`` and ``image_error`` with all that :func:`held_out_scores` says of them, ``noise_floor``,
        ``moved_share``, ``local_spectrum`` (direction). The attribute ``held_out`` says which recording it was.

    Raises:
        InvalidRecording: No images.
        WrongResult: What was learned answers in other shapes, or not in finite numbers.
    """
    other = use is not None and "hand_image" in use and bool(np.isfinite(use["hand_image"].values).any())
    exp = experience(use if other and use is not None else seen)
    part = metrics.all_hidden(exp)
    floor = noise_of(exp) if noise is None else _checks.number("noise", noise, least=0.0)
    row: dict[str, float] = dict.fromkeys(_NUMBERS, float("nan"))
    row |= _Judged.of([_of_pairs(learned, part)]).scores("pair", floor, 0)
    if isinstance(learned, LearnedImage):
        row |= _Judged.of([_of_images(learned, part)]).scores("image", floor, 0)
    spectrum = _spectrum(exp)
    found = xr.Dataset({name: ((), value) for name, value in row.items()})
    found["noise_floor"], found["moved_share"] = float(floor), spectrum.share
    found["local_spectrum"] = ("direction", _mean_spectrum(spectrum))
    found.attrs["held_out"] = str(other)
    return _with_units(found, exp)


def foretold(
    kind: Literal["pair", "image"], learned: Sequence[Learned], parts: Sequence[HeldOut], noise: float = float("nan")
) -> metrics.ObservedError:
    """What was learned without each part, held against that part; the error of all parts together.

    Args:
        kind: ``"pair"``: displacements between neighbouring postures; ``"image"``: hand images, of learners of these.
        learned: One for each part.
        parts: What was hidden.
        noise: As of :func:`held_out_scores`; NaN: unknown, the floor is 0.

    Raises:
        WrongResult: What was learned answers in other shapes, or not in finite numbers.
    """
    of = _of_pairs if kind == "pair" else _of_images
    return _Judged.of([of(one, part) for one, part in zip(learned, parts, strict=True)]).error(kind, noise)


def noise_of(exp: xr.Dataset) -> float:
    """The noise of one image, from repeats of postures [unit]; NaN where nothing is repeated."""
    if "repeat" not in exp or "hand_image" not in exp:
        return float("nan")
    return metrics.noise_floor(exp["hand_image"].values, exp["repeat"].values)


# Inner ---------------------------------------------------------------------------------------------------------------

_NUMBERS = tuple(
    f"{kind}_error{suffix}"
    for kind in ("pair", "image")
    for suffix in ("", "_corrected", "_relative", "_relative_corrected", "_relative_lower", "_relative_upper")
)


@dataclass(frozen=True, eq=False)
class _Judged:
    """Predictions of one kind against observations, all folds together.

    Attributes:
        predicted: (rows, m) [unit].
        observed: (rows, m) [unit].
        run: (rows,) stretch of each.
        fold: (rows,) fold of each.
    """

    predicted: Float[np.ndarray, "rows m"]
    observed: Float[np.ndarray, "rows m"]
    run: Int[np.ndarray, "rows"]
    fold: Int[np.ndarray, "rows"]

    @classmethod
    def of(cls, parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> _Judged:
        predicted, observed, run = (np.concatenate(one) for one in zip(*parts, strict=True))
        return cls(predicted, observed, run, np.repeat(np.arange(len(parts)), [len(part[2]) for part in parts]))

    def error(self, kind: str, noise: float) -> metrics.ObservedError:
        of = metrics.pair_error if kind == "pair" else metrics.image_error
        return of(self.predicted, self.observed, 0.0 if np.isnan(noise) else noise)

    def scores(self, kind: str, noise: float, seed: int) -> dict[str, float]:
        found = self.error(kind, noise)
        size = self.observed if kind == "pair" else self.observed - self.observed.mean(0)
        lower, upper = self._interval(size, seed)
        known = not np.isnan(noise)
        return {
            f"{kind}_error": found.error,
            f"{kind}_error_relative": found.relative,
            f"{kind}_error_corrected": found.corrected if known else float("nan"),
            f"{kind}_error_relative_corrected": found.relative_corrected if known else float("nan"),
            f"{kind}_error_relative_lower": lower,
            f"{kind}_error_relative_upper": upper,
        }

    def _interval(self, size: Float[np.ndarray, "rows m"], seed: int) -> tuple[float, float]:
        """Of the relative error, over stretches (BCa bootstrap)."""
        numbers, place = np.unique(self.run, return_inverse=True)
        if len(numbers) < _FEWEST:
            return float("nan"), float("nan")
        wrong, moved = np.zeros(len(numbers)), np.zeros(len(numbers))
        np.add.at(wrong, place, ((self.predicted - self.observed) ** 2).sum(1))
        np.add.at(moved, place, (size**2).sum(1))
        if not wrong.any():
            return 0.0, 0.0
        found = ratio_of_sums(wrong, moved, resamples=_RESAMPLES, seed=seed)
        return found.lower, found.upper


def _row(estimator: Estimator, parts: list[HeldOut], noise: float, seed: int) -> dict[str, Any]:
    """All numbers of one estimator; NaN, and why, where it cannot learn from what is seen."""
    row: dict[str, Any] = dict.fromkeys(_NUMBERS, float("nan"))
    row |= {"by_fold": np.full(len(parts), np.nan), "failure": ""}
    try:
        learned = [estimator.fit(part.seen, seed) for part in parts]
        pairs = _Judged.of([_of_pairs(one, part) for one, part in zip(learned, parts, strict=True)])
        images = None
        if all(isinstance(one, LearnedImage) for one in learned):
            images = _Judged.of([_of_images(one, part) for one, part in zip(learned, parts, strict=True)])
    except BodyImageKinError as problem:
        return row | {"failure": str(problem)}
    row |= pairs.scores("pair", noise, seed)
    row["by_fold"] = np.array(
        [
            metrics.pair_error(pairs.predicted[pairs.fold == fold], pairs.observed[pairs.fold == fold]).relative
            for fold in range(len(parts))
        ]
    )
    return row if images is None else row | images.scores("image", noise, seed)


def _of_pairs(learned: Learned, part: HeldOut) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    observed = part.hidden.dr.numpy()
    with torch.no_grad():
        predicted = checked("predicted pairs", metrics.predicted_pairs(learned, part.hidden), observed.shape)
    return predicted, observed, part.run_of_pair


def _of_images(learned: Learned, part: HeldOut) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    assert isinstance(learned, LearnedImage)
    with torch.no_grad():
        predicted = as_float_array(learned.hand_image(torch.from_numpy(part.q)), "hand images")
    return checked("predicted hand images", predicted, part.image.shape), part.image, part.run


def _with_units(found: xr.Dataset, exp: xr.Dataset) -> xr.Dataset:
    unit = str(exp["hand_image"].attrs.get("units", "1"))
    for name in map(str, found.data_vars):
        relative = "relative" in name or name in ("by_fold", "moved_share", "local_spectrum", "failure")
        found[name].attrs["units"] = "1" if relative else unit
    return found


def _spectrum(exp: xr.Dataset) -> metrics.LocalSpectrum:
    q = exp["q"].values
    seen = np.isfinite(q).all(-1)
    if "hand_image" in exp:
        seen &= np.isfinite(exp["hand_image"].values).all(-1)
    return metrics.local_spectrum(q[seen], noise=float(exp.attrs.get("encoder_noise", 0.0)))


def _mean_spectrum(spectrum: metrics.LocalSpectrum) -> Float[np.ndarray, "direction"]:
    """Singular values over the largest of their posture, mean over postures."""
    largest = np.maximum(spectrum.values[:, :1], 1e-300)
    return np.asarray((spectrum.values / largest).mean(0))
