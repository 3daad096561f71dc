"""The tables of a study's page: estimators ranked, all their other scores, and each against a baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from bodyimage_kin.report._results import (
    HEADLINE,
    Interval,
    asked,
    intervals_of,
    learned,
    names_of,
    place_of,
    probe_of_use,
    title_of,
)
from bodyimage_kin.study import summary

_HIDDEN = "pair_error_relative"
"""The score by which estimators are ordered where no truth is known."""


def tables(
    results: xr.Dataset, medians: Mapping[str, xr.Dataset], comparison: Mapping[str, Any] | None
) -> list[dict[str, Any]]:
    """For each embodiment and recording: estimators ranked, and all their other scores."""
    found = []
    probes = names_of(results, "probe")
    # What they are ranked by comes first: on a phone nothing else is seen at once.
    first_use = sorted(range(len(probes)), key=lambda index: probes[index] != probe_of_use(results))
    for embodiment in names_of(results, "embodiment"):
        for recording in names_of(results, "recording"):
            at = {"embodiment": embodiment, "recording": recording}
            there = [
                name
                for name in names_of(results, "estimator")
                if asked(results.sel({**at, "estimator": name}), medians)
            ]
            ranked = []
            if HEADLINE in medians:
                of = [name for name in there if asked(results.sel({**at, "estimator": name}), [HEADLINE])]
                ranked = [
                    (name, [values[index] for index in first_use])
                    for name, values in _ranked(medians[HEADLINE].sel({**at, "estimator": of}), probe_of_use(results))
                ]
            order = [name for name, _ in ranked]
            if not order and judged_by_hidden(medians):
                order = [name for name, _ in _ranked(medians[_HIDDEN].sel({**at, "estimator": there}))]
            order += [name for name in there if name not in order]
            found.append(
                {
                    "place": place_of(results, embodiment, recording),
                    "probes": probes,
                    "ranked_probes": [probes[index] for index in first_use],
                    "ranked": ranked,
                    "unasked": [name for name in names_of(results, "estimator") if name not in there],
                    "ratios": comparison["ratios"].get(recording, {}) if comparison else {},
                    "by_probe": [
                        (title_of(results, score), _rows(one.sel(at), order))
                        for score, one in medians.items()
                        if "probe" in one.dims and score != HEADLINE
                    ],
                    "alone": [
                        (title_of(results, score), dict(_rows(one.sel(at), order)))
                        for score, one in medians.items()
                        if "probe" not in one.dims
                    ],
                    "order": order,
                }
            )
    return found


def judged_by_hidden(medians: Mapping[str, xr.Dataset]) -> bool:
    """Whether no truth is known, and errors are those of motions that were hidden."""
    return HEADLINE not in medians and _HIDDEN in medians


def _ranked(medians: xr.Dataset, probe: str | None = None) -> list[tuple[str, list[Interval]]]:
    middle = medians["median"] if probe is None else medians["median"].sel(probe=probe)
    order = middle.fillna(np.inf).argsort().values
    return _rows(medians, [names_of(medians, "estimator")[index] for index in order])


def _rows(medians: xr.Dataset, order: Sequence[str]) -> list[tuple[str, list[Interval]]]:
    return [(name, intervals_of(medians.sel(estimator=name))) for name in order]


def comparison_with(results: xr.Dataset, baseline: str | None) -> dict[str, Any] | None:
    """Every estimator against the baseline where they are used, of those that are not the truth itself."""
    names = learned(results)
    baseline = baseline or (names[0] if names else "")
    if HEADLINE not in results or baseline not in names or len(names) < 2:
        return None
    # One family, that of a published table: of what is not shown nothing is adjusted for.
    at_use = summary.compare(results.sel(estimator=names, probe=probe_of_use(results)), HEADLINE, baseline)
    ratios = {
        recording: {
            name: {key: float(at_use[key].sel(estimator=name, recording=recording)) for key in at_use.data_vars}
            for name in names_of(at_use, "estimator")
        }
        for recording in names_of(at_use, "recording")
    }
    return {"baseline": baseline, "ratios": ratios, "family": at_use.attrs["family"]}
