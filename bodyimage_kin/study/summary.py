"""A study's results in few numbers: means with intervals, and every estimator against a baseline."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.study import statistics

_UNITS = ("embodiment", "seed")


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
        for name, value in zip(found, (one.estimate, one.lower, one.upper, one.recordings), strict=True):
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
        "recordings": [row.ratio.recordings for row in rows],
        "p": p,
        "p_holm": statistics.holm(p),
    }
    coords = {dim: values[dim] for dim in inner if dim in values.coords}
    variables = {name: ((*inner, "estimator"), np.reshape(one, shape)) for name, one in found.items()}
    return xr.Dataset(variables, {**coords, "estimator": others}, {**values.attrs, "baseline": baseline})


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


def _score(results: xr.Dataset, score: str) -> xr.DataArray:
    if score not in results:
        known = [str(name) for name, one in results.data_vars.items() if "estimator" in one.dims and name != "failure"]
        raise UnknownName("score in the results", score, known)
    return results[score]


def _places(values: xr.DataArray, dims: Sequence[str]) -> list[dict[Hashable, int]]:
    """Every place along these dimensions."""
    return [dict(zip(dims, at, strict=True)) for at in itertools.product(*(range(values.sizes[dim]) for dim in dims))]
