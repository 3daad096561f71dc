"""A study's results in few numbers: medians with intervals, estimators against each other, how scores go together."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import statistics

__all__ = [
    "EXACT",
    "chain",
    "compare",
    "exact",
    "failures",
    "markdown_table",
    "plain_markdown",
    "plain_numbers",
    "refuse_failed",
    "summarise",
]

_UNITS = ("embodiment", "seed")
EXACT = 1e-6
"""A relative error below this is that of the truth itself."""


def exact(results: xr.Dataset, score: str) -> list[str]:
    """Estimators that are the truth itself: exact (to :data:`EXACT`) in all that they were asked, at every probe.

    They have no place on a logarithmic axis or in a ratio. One that is exact now and then, such as self-calibration
    without noise, is none of them.

    Args:
        results: Of :meth:`Study.run`.
        score: Name of a relative error.
    """
    errors = _score(results, score)
    within = [dim for dim in errors.dims if dim not in ("estimator", "embodiment", "recording")]
    asked = errors.notnull().any(within)
    right = (asked & (errors < EXACT).all(within)) | ~asked
    there = asked.any(["embodiment", "recording"]) & right.all(["embodiment", "recording"])
    return [str(name) for name in errors["estimator"].values if bool(there.sel(estimator=name))]


def summarise(results: xr.Dataset, score: str) -> xr.Dataset:
    """Median of a score over recordings with its 95 % interval, and how recordings are spread.

    A learned Jacobian may have a pole on the face, and then a mean is that of the few recordings that come near it.

    Args:
        results: Of :meth:`Study.run`.
        score: Name of one of its scores.

    Returns:
        ``median``, ``lower``, ``upper``, ``low`` and ``high`` (a tenth of the recordings lies beyond each),
        ``above_one`` (their share) and ``recordings``, over every dimension of the score but ``seed``
        (:func:`~bodyimage_kin.study.statistics.spread`). A recording that failed is left out, so hold ``recordings``
        beside the median.

    Raises:
        UnknownName: No such score.
    """
    values = _score(results, score)
    grid = [str(dim) for dim in values.dims if dim != "seed"]
    every = [statistics.spread(values.isel(place).values) for place in _places(values, grid)]
    found: dict[str, list[float]] = {
        "recordings" if name == "units" else name: [getattr(one, name) for one in every]
        for name in ("median", "lower", "upper", "low", "high", "above_one", "units")
    }
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
        all comparisons in the answer, the attribute ``family`` says which: choose a probe before
        (``results.sel(probe="on_face")``) for the family of pages and published tables.

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
    sizes = {"estimator": len(others), **{dim: values.sizes[dim] for dim in inner}}
    made = int(np.isfinite(p).sum())
    grid = " x ".join(f"{count} {_many(dim, count)}" for dim, count in sizes.items())
    family = f"{made} {'comparison' if made == 1 else 'comparisons'}: {grid}" + (
        "" if made == p.size else ", where both have a score"
    )
    attributes = {**values.attrs, "baseline": baseline, "family": family}
    return xr.Dataset(variables, {**coords, "estimator": others}, attributes)


def chain(
    results: xr.Dataset,
    from_score: str,
    to_score: str,
    *,
    probe: str = "on_face",
    leave_out: Collection[str] = (),
    families: Mapping[str, str] | None = None,
    level: float | int = 0.95,
    seed: int = 0,
) -> xr.Dataset:
    """How much one score of a learned Jacobian goes with another, over estimators: Spearman's rank correlations.

    What varies in such a claim is the estimator, and near copies of one are one finding: families count once
    (:func:`~bodyimage_kin.study.statistics.correlation`).

    Args:
        results: Of :meth:`Study.run`.
        from_score: Name of one of its scores, such as ``"relative_error_use"``.
        to_score: Of another, such as ``"touch_trajectory_rmse"`` or ``"map_error"``.
        probe: Where scores are taken that there are of several probes.
        leave_out: Names of estimators that are left out, such as the truth itself or estimators that learn nothing: by
            being far from all others, they alone can make a correlation.
        families: Estimator -> family of near copies; whoever is not named is one of its own.
        level: Of confidence.
        seed: Of the resampling.

    Returns:
        Over ``embodiment``: ``correlation`` of the estimators' medians over recordings, with ``lower`` and ``upper``,
        from resampling families; NaN with too few of them for an interval. ``within``: median over recordings of the
        correlation over the families that learned from one, ``within_low`` and ``within_high``, beyond each of which a
        tenth of the recordings lies: how much recordings differ, and no interval. ``families``, ``estimators`` and
        ``recordings``, how many there are. A cell that failed is left out; a score that does not vary, such as a
        topological error of zero for all, has no rank and so no correlation: NaN.

    Raises:
        UnknownName: No such score, probe or estimator.
        InvalidConfig: A score with other dimensions, no estimator left, or a level outside 0 to 1.
    """
    names = [str(name) for name in results["estimator"].values]
    for name in (*leave_out, *(families or {})):
        if name not in names:
            raise UnknownName("estimator", name, names)
    kept = [name for name in names if name not in leave_out]
    if not kept:
        raise InvalidConfig("leave_out names every estimator; leave at least one in")
    values = [_of_cells(results.sel(estimator=kept), score, probe) for score in (from_score, to_score)]
    label = [(families or {}).get(name, name) for name in kept]
    found: dict[str, list[float]] = {}
    for embodiment in results["embodiment"].values:
        x, y = (one.sel(embodiment=embodiment).values.reshape(-1, len(kept)) for one in values)
        both = ~(np.isnan(x) | np.isnan(y))
        x, y = np.where(both, x, np.nan), np.where(both, y, np.nan)
        one, other = ([statistics.spread(column).median for column in table.T] for table in (x, y))
        over = statistics.correlation(one, other, label, level=level, seed=seed)
        inside = [statistics.correlation(*rows, label, resamples=1).estimate for rows in zip(x, y, strict=True)]
        within = statistics.spread(np.array(inside))
        for name, value in {
            "correlation": over.estimate,
            "lower": over.lower,
            "upper": over.upper,
            "within": within.median,
            "within_low": within.low,
            "within_high": within.high,
            "families": over.units,
            "estimators": int(both.any(0).sum()),
            "recordings": int(both.any(1).sum()),
        }.items():
            found.setdefault(name, []).append(float(value))
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


def refuse_failed(results: xr.Dataset, but: str = "") -> None:
    """Refuses results of which a cell failed, for whoever judges them all.

    Args:
        results: Of :meth:`Study.run`.
        but: Name of an error that may be.

    Raises:
        InvalidConfig: One failed; says which, and why.
    """
    wrong = [one for one in failures(results) if not (but and one["failure"].startswith(but))]
    if wrong:
        raise InvalidConfig(
            f"{len(wrong)} cells failed, {wrong[0]['recording']}/{wrong[0]['estimator']} first: "
            f"{wrong[0]['failure']}; run it again with retry=True"
        )


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


def plain_numbers(value: Any, digits: int | None = 5) -> Any:
    """Results as a JSON file keeps them: numbers to a few digits, and None for those that are not finite.

    Args:
        value: A number, or mappings, sequences and arrays of them, nested as they may be; anything else stays as it is.
        digits: How many are significant; None: all.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: plain_numbers(item, digits) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_numbers(item, digits) for item in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            return None
        return value if digits is None else float(f"{value:.{digits}g}")
    return value


def _many(dim: str, count: int) -> str:
    return {"axis": "axes"}.get(dim, f"{dim}s") if count != 1 else dim


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
