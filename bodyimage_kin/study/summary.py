"""A study's results in few numbers: means with intervals, estimators against each other, how scores go together."""

from __future__ import annotations

import itertools
import json
from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import statistics

__all__ = ["EXACT", "chain", "compare", "exact", "failures", "markdown_table", "plain_markdown", "summarise"]

_UNITS = ("embodiment", "seed")
EXACT = 1e-6
"""A relative error below this is that of the truth itself."""


def exact(results: xr.Dataset, score: str) -> list[str]:
    """Estimators that are the truth itself: exact (to :data:`EXACT`) in every recording and at every probe.

    They have no place on a logarithmic axis or in a ratio. One that is exact now and then, such as self-calibration
    without noise, is none of them.

    Args:
        results: Of :meth:`Study.run`.
        score: Name of a relative error.
    """
    errors = _score(results, score)
    return [str(name) for name in errors["estimator"].values if bool((errors.sel(estimator=name) < EXACT).all())]


def summarise(results: xr.Dataset, score: str, *, seed: int = 0) -> xr.Dataset:
    """Mean of a score over recordings, with its 95 % interval.

    Args:
        results: Of :meth:`Study.run`.
        score: Name of one of its scores.
        seed: Of the resampling.

    Returns:
        ``mean``, ``lower``, ``upper`` and ``recordings`` over every dimension of the score but ``seed``. A recording
        that failed is left out, so hold ``recordings`` beside the mean.

    Raises:
        UnknownName: No such score.
    """
    values = _score(results, score)
    grid = [str(dim) for dim in values.dims if dim != "seed"]
    found: dict[str, list[float]] = {name: [] for name in ("mean", "lower", "upper", "recordings")}
    for place in _places(values, grid):
        one = statistics.interval(values.isel(place).values, seed=seed)
        for name, value in zip(found, (one.estimate, one.lower, one.upper, one.units), strict=True):
            found[name].append(value)
    shape = [values.sizes[dim] for dim in grid]
    coords = {dim: values[dim] for dim in grid if dim in values.coords}
    return xr.Dataset({name: (grid, np.reshape(one, shape)) for name, one in found.items()}, coords, values.attrs)


def compare(results: xr.Dataset, score: str, baseline: str, *, seed: int = 0) -> xr.Dataset:
    """Every estimator against one of them: geometric mean ratio of a score, paired by recording.

    Args:
        results: Of :meth:`Study.run`.
        score: Name of a score that is positive.
        baseline: Name of the estimator they are held against.
        seed: Of the resampling.

    Returns:
        ``ratio``, ``lower``, ``upper``, ``recordings``, ``p`` and ``p_holm`` over ``estimator`` (without the baseline)
        and every dimension of the score but embodiment and seed. Embodiments are strata. Holm's adjustment is over
        all comparisons in the answer.

    Raises:
        UnknownName: No such score or baseline.
        InvalidConfig: No other estimator.
    """
    values = _score(results, score)
    names = [str(name) for name in values["estimator"].values]
    if baseline not in names:
        raise UnknownName("estimator to compare with", baseline, names)
    others = [name for name in names if name != baseline]
    if not others:
        raise InvalidConfig(f"'{baseline}' is the study's only estimator; there is nothing to compare it with")
    inner = [str(dim) for dim in values.dims if dim not in (*_UNITS, "estimator")]
    rows = []
    for place in _places(values, inner):
        one = values.isel(place).transpose("estimator", *_UNITS)
        strata = {
            name: {str(b): one.sel(estimator=name, embodiment=b).values for b in one["embodiment"].values}
            for name in names
        }
        for name in others:
            rows.append(statistics.compare({name: strata[name], baseline: strata[baseline]}, baseline, seed=seed)[name])
    shape = [*(values.sizes[dim] for dim in inner), len(others)]
    p = np.array([row.p for row in rows])
    found: Mapping[str, Any] = {
        "ratio": [row.ratio.estimate for row in rows],
        "lower": [row.ratio.lower for row in rows],
        "upper": [row.ratio.upper for row in rows],
        "recordings": [row.ratio.units for row in rows],
        "p": p,
        "p_holm": statistics.holm(p),
    }
    coords = {dim: values[dim] for dim in inner if dim in values.coords}
    variables = {name: ((*inner, "estimator"), np.reshape(one, shape)) for name, one in found.items()}
    return xr.Dataset(variables, {**coords, "estimator": others}, {**values.attrs, "baseline": baseline})


def chain(
    results: xr.Dataset,
    from_score: str,
    to_score: str,
    *,
    probe: str = "on_face",
    leave_out: Collection[str] = (),
    level: float | int = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> xr.Dataset:
    """How much one score of a learned Jacobian goes with another: Spearman's rank correlations and their intervals.

    Args:
        results: Of :meth:`Study.run`.
        from_score: Name of one of its scores, such as ``"relative_error_use"``.
        to_score: Of another, such as ``"touch_trajectory_rmse"`` or ``"map_error"``.
        probe: Where scores are taken that there are of several probes.
        leave_out: Names of estimators that are left out, such as the truth itself or estimators that learn nothing: by
            being far from all others, they alone can make a correlation.
        level: Of confidence.
        resamples: Number of bootstrap samples.
        seed: Of the resampling.

    Returns:
        Over ``embodiment``: ``correlation`` over all cells (one an estimator, motion and seed), ``within`` the mean
        over recordings of the correlation over the estimators that learned from one (three at least), each with
        ``lower`` and ``upper`` (``within_lower``, ``within_upper``); ``cells`` and ``recordings``, how many there are.
        A cell that failed is left out; a score that does not vary, such as a topological error of zero for all, has no
        rank and so no correlation: NaN. Intervals are percentiles of a bootstrap whose unit is the recording with all
        its cells, within each motion; NaN with fewer than three recordings of a motion.

    Raises:
        UnknownName: No such score, probe or estimator.
        InvalidConfig: A score with other dimensions, no estimator left, a level outside 0 to 1, or no resamples.
    """
    if not 0 < level < 1 or resamples < 1:
        raise InvalidConfig(f"level={level!r}, resamples={resamples!r}: give a level between 0 and 1, and resamples")
    names = [str(name) for name in results["estimator"].values]
    for name in leave_out:
        if name not in names:
            raise UnknownName("estimator to leave out", name, names)
    kept = [name for name in names if name not in leave_out]
    if not kept:
        raise InvalidConfig("leave_out names every estimator; leave at least one in")
    values = [_of_cells(results.sel(estimator=kept), score, probe) for score in (from_score, to_score)]
    found: dict[str, list[float]] = {}
    for embodiment in results["embodiment"].values:
        x, y = (one.sel(embodiment=embodiment).values for one in values)
        for name, value in _chain(x, y, float(level), resamples, seed).items():
            found.setdefault(name, []).append(value)
    attributes = {"from": from_score, "to": to_score, "probe": probe, "left_out": json.dumps(list(leave_out))}
    variables = {name: (("embodiment",), one) for name, one in found.items()}
    return xr.Dataset(variables, {"embodiment": results["embodiment"]}, attributes)


def failures(results: xr.Dataset) -> list[dict[str, Any]]:
    """Every failure once: ``embodiment``, ``recording``, ``estimator``, ``seeds`` and what went wrong.

    Args:
        results: Of :meth:`Study.run`.
    """
    found: dict[tuple[str, str, str, str], list[int]] = {}
    said = results["failure"].transpose("embodiment", "recording", "estimator", "seed")
    for place in np.argwhere(said.values != ""):
        one = said[tuple(place)]
        embodiment, recording, estimator = (str(one[dim].item()) for dim in ("embodiment", "recording", "estimator"))
        found.setdefault((embodiment, recording, estimator, str(one.item())), []).append(int(one["seed"]))
    return [
        {"embodiment": key[0], "recording": key[1], "estimator": key[2], "seeds": seeds, "failure": key[3]}
        for key, seeds in found.items()
    ]


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[object]], words: int = 1) -> str:
    """A table as Markdown.

    Args:
        head: Of each column.
        rows: Cells, as they are to be read: what would end one, or begin HTML, is escaped.
        words: How many columns are of words, flush left; the others are of numbers, flush right.
    """
    rule = ["---"] * words + ["---:"] * (len(head) - words)
    return "\n".join(f"| {' | '.join(map(plain_markdown, cells))} |" for cells in (head, rule, *rows))


def plain_markdown(cell: object) -> str:
    """Text, a user's name say, as Markdown shows it: neither a column of its own nor HTML."""
    return " ".join(str(cell).replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|").split())


def _score(results: xr.Dataset, score: str) -> xr.DataArray:
    if score not in results:
        known = [str(name) for name, one in results.data_vars.items() if "estimator" in one.dims and name != "failure"]
        raise UnknownName("score in the results", score, known)
    return results[score]


def _places(values: xr.DataArray, dims: Sequence[str]) -> list[dict[Hashable, int]]:
    """Every place along these dimensions."""
    return [dict(zip(dims, at, strict=True)) for at in itertools.product(*(range(values.sizes[dim]) for dim in dims))]


def _of_cells(results: xr.Dataset, score: str, probe: str) -> xr.DataArray:
    """A score of each cell, over embodiment, recording, seed and estimator."""
    values = _score(results, score)
    if "probe" in values.dims:
        probes = [str(name) for name in values["probe"].values]
        if probe not in probes:
            raise UnknownName("probe in the results", probe, probes)
        values = values.sel(probe=probe)
    grid = ("embodiment", "recording", "seed", "estimator")
    if other := [str(dim) for dim in values.dims if dim not in grid]:
        raise InvalidConfig(f"{score} is not one number a cell; choose along {', '.join(other)} with results.sel first")
    return values.transpose(*grid)


def _chain(
    x: Float[np.ndarray, "recording seed estimator"],
    y: Float[np.ndarray, "recording seed estimator"],
    level: float,
    resamples: int,
    seed: int,
) -> dict[str, float]:
    """Correlations of one embodiment, with intervals."""
    there = np.isfinite(x) & np.isfinite(y)
    motions, seeds, estimators = x.shape
    unit = np.broadcast_to(np.arange(motions * seeds).reshape(motions, seeds, 1), x.shape)[there]
    inside = np.full(motions * seeds, np.nan)
    rows = (values.reshape(-1, estimators) for values in (x, y, there))
    for index, (one, other, kept) in enumerate(zip(*rows, strict=True)):
        if kept.sum() >= 3:
            inside[index] = _rank_correlation(one[kept], other[kept], np.ones(int(kept.sum())))
    ranked = np.isfinite(inside)
    found = {
        "correlation": float(_rank_correlation(x[there], y[there], np.ones(int(there.sum())))),
        "within": float(inside[ranked].mean()) if ranked.any() else np.nan,
        "cells": float(there.sum()),
        "recordings": float(there.any(-1).sum()),
    }
    drawn = _drawn(there.any(-1), resamples, seed)
    at_once = max(1, 10**6 // max(1, unit.size))
    parts = [drawn[begin : begin + at_once] for begin in range(0, len(drawn), at_once)]
    over_cells = [_rank_correlation(x[there], y[there], part[:, unit]) for part in parts]
    of = drawn[:, ranked]
    of = of[of.any(1)]
    over_recordings = of @ inside[ranked] / of.sum(1)
    for prefix, samples in (("", np.concatenate([*over_cells, []])), ("within_", over_recordings)):
        samples = samples[np.isfinite(samples)]
        ends = np.quantile(samples, [(1 - level) / 2, (1 + level) / 2]) if samples.size else (np.nan, np.nan)
        found |= {f"{prefix}lower": float(ends[0]), f"{prefix}upper": float(ends[1])}
    return found


def _drawn(
    usable: Bool[np.ndarray, "recording seed"], resamples: int, seed: int
) -> Float[np.ndarray, "resamples units"]:
    """How often each recording is drawn: its cells come together, so none counts as independent of the others."""
    if (usable.sum(1) < 3).any():
        return np.empty((0, usable.size))
    drawn = np.zeros((resamples, *usable.shape))
    rng = np.random.default_rng(seed)
    for motion, there in enumerate(usable):
        count = int(there.sum())
        drawn[:, motion, there] = rng.multinomial(count, np.full(count, 1 / count), size=resamples)
    return drawn.reshape(resamples, -1)


def _rank_correlation(
    x: Float[np.ndarray, "cells"], y: Float[np.ndarray, "cells"], weights: Float[np.ndarray, "*samples cells"]
) -> Float[np.ndarray, "*samples"]:
    """Spearman's correlation when each cell occurs as often as its weight says; NaN where either does not vary."""
    if x.size == 0:
        return np.full(weights.shape[:-1], np.nan)
    total = weights.sum(-1, keepdims=True)
    # The mean rank is the same for any order.
    a, b = (_mean_ranks(values, weights) - (total + 1) / 2 for values in (x, y))
    size = np.sqrt((weights * a**2).sum(-1) * (weights * b**2).sum(-1))
    return np.where(size > 0, (weights * a * b).sum(-1) / np.where(size > 0, size, 1), np.nan)


def _mean_ranks(
    values: Float[np.ndarray, "cells"], weights: Float[np.ndarray, "*samples cells"]
) -> Float[np.ndarray, "*samples cells"]:
    """Rank of each cell, from 1, when each occurs as often as its weight says; ties share the mean of theirs."""
    _, first, group = np.unique(values, return_index=True, return_inverse=True)
    order = np.argsort(group, kind="stable")
    begins = np.searchsorted(group[order], np.arange(len(first)))
    occurs = np.add.reduceat(weights[..., order], begins, axis=-1)
    return (np.cumsum(occurs, axis=-1) - (occurs - 1) / 2)[..., group]
