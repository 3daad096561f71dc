"""Scores of doubt: does a learned Jacobian know how wrong it is, at the probes and on the map?

At a probe, what is foretold is the displacement of the hand image along each principal direction of the motion of use,
as long as that motion is in it: so the squared errors add up to that of ``relative_error_use``, and the error that is
foretold may be held against it. On the map, functions drawn from what was learned (:meth:`Drawn.draws`) are integrated,
each teaches a map, and their spread is held against the map of the true Jacobian, integrated alike.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body_image import BodyImageDraws
from bodyimage_kin.estimators import Analytic, Drawn, Uncertain
from bodyimage_kin.study.answers import answers, checked
from bodyimage_kin.study.context import IMAGE, Context, LeftOut, Score
from bodyimage_kin.study.store import padded

__all__ = ["DOUBT"]

_DRAWS = 60
"""Functions that are drawn for a map."""
_LEVELS = (50, 90, 95)
"""Of the regions [percent], as :func:`bodyimage_kin.metrics.uncertainty_scores` has them."""
_ENDS = ("lower", "upper")
_AT_PROBES = ("body", "learned")
_ON_MAP = ("body", "learned", "maps")


def _at_probes(name: str) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        if "doubt at probes" not in context.shared:
            context.shared["doubt at probes"] = _doubt_at_probes(context)
        found = context.shared["doubt at probes"]
        return padded([found[probe][name] if probe in found else None for probe in context.probes])

    return of


def _doubt_at_probes(context: Context) -> dict[str, dict[str, Any]]:
    """Probe -> every score of the doubt there.

    Raises:
        LeftOut: What was learned gives no covariance.
        WrongResult: A covariance of another shape, or not finite.
    """
    learned = context.learned
    if not isinstance(learned, Uncertain):
        raise LeftOut("what is learned gives no covariance")
    values, vectors = np.linalg.eigh(context.motion_metric)
    along = vectors * np.sqrt(values.clip(min=0.0))
    found = {}
    for probe, J in context.true_jacobians.items():
        (count, m, p), q = J.shape, context.postures[probe].numpy()
        with torch.no_grad():
            covariance = answers(learned.covariance, q)
        covariance = checked(f"covariance at probe '{probe}'", covariance, (count, m * p, m * p))
        of_entries = covariance.reshape(count, m, p, m, p)
        true, mean = (np.swapaxes(one @ along, 1, 2) for one in (J, context.learned_jacobians[probe]))
        S = np.einsum("najbl,jk,lk->nkab", of_entries, along, along, optimize=True)
        foretold = np.trace(S, axis1=2, axis2=3).sum() / (true**2).sum()
        found[probe] = _scores(true, mean, S) | {"relative_error_foretold": np.sqrt(max(foretold, 0.0))}
    return found


def _on_map(name: str) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        if "doubt on the map" not in context.shared:
            context.shared["doubt on the map"] = _doubt_on_map(context)
        return context.shared["doubt on the map"][name]

    return of


def _doubt_on_map(context: Context) -> dict[str, Any]:
    """Every score of the doubt about the map that the first of the first maps leads to.

    Raises:
        LeftOut: What was learned gives no draws.
    """
    if not isinstance(context.learned, Drawn):
        raise LeftOut("what is learned gives no draws")
    assert context.body is not None
    drawn = [context.hand_by(one) for one in context.learned.draws(_DRAWS, context.seed)]
    truth = context.hand_by(Analytic(context.body).fit(context.experience))
    first, m = context.map_seeds[1], context.body.m
    maps = BodyImageDraws(tuple(context.learn_map(hand, first) for hand in drawn))
    true = context.learn_map(truth, first).tactile_map
    return _scores(true.reshape(-1, m), maps.mean.reshape(-1, m), maps.covariance.reshape(-1, m, m))


def _scores(
    true: Float[np.ndarray, "*batch m"],
    mean: Float[np.ndarray, "*batch m"],
    covariance: Float[np.ndarray, "*batch m m"],
) -> dict[str, Any]:
    held = metrics.coverage(true, mean, covariance, [level / 100 for level in _LEVELS])
    found: dict[str, Any] = metrics.uncertainty_scores(true, mean, covariance)
    return found | {"coverage_interval": np.stack([held.lower, held.upper], axis=1)}


def _regions(prefix: str, of: Callable[[str], Callable[[Context], Any]], settings: dict[str, Any]) -> list[Score]:
    """The coverages, and their interval."""
    dims = settings.pop("dims")
    what = "taxels" if prefix else "displacements"
    return [
        *(
            Score(
                f"{prefix}coverage_{level}", dims, f"share of {what} within their region of {level} %",
                of(f"coverage_{level}"), source="coverage", ratio=False, optional=True, **settings,
            )
            for level in _LEVELS
        ),
        Score(
            f"{prefix}coverage_interval", (*dims, "level", "end"),
            f"95 % interval of these shares, exact were {what} independent", of("coverage_interval"),
            labels={"level": tuple(map(str, _LEVELS)), "end": _ENDS}, source="coverage", ratio=False, optional=True,
            **settings,
        ),
    ]  # fmt: skip


_PROBE: dict[str, Any] = {"dims": ("probe",), "needs": _AT_PROBES}
_MAP: dict[str, Any] = {"dims": (), "needs": _ON_MAP}
DOUBT: tuple[Score, ...] = (
    Score(
        "relative_error_foretold", long_name="relative error that is foretold, motion's metric",
        of=_at_probes("relative_error_foretold"), source="sharpness", optional=True, **_PROBE,
    ),
    Score(
        "negative_log_likelihood", long_name="surprise at true displacements, mean [nats]",
        of=_at_probes("negative_log_likelihood"), source="negative_log_likelihood", ratio=False, optional=True,
        **_PROBE,
    ),
    Score(
        "crps", long_name="continuous ranked probability score of displacements, mean", of=_at_probes("crps"),
        units=IMAGE, source="crps", optional=True, **_PROBE,
    ),
    *_regions("", _at_probes, dict(_PROBE)),
    Score(
        "sparsification_gain", long_name="whether errors are large where it doubts: 1 perfectly, 0 at random",
        of=_at_probes("sparsification_gain"), source="sparsification", ratio=False, optional=True, **_PROBE,
    ),
    Score(
        "map_error_made", long_name="distance of the map from that of the true Jacobian, integrated alike",
        of=_on_map("error"), units=IMAGE, source="uncertainty_scores", optional=True, **_MAP,
    ),
    Score(
        "map_error_foretold", long_name="the same distance, as it is foretold", of=_on_map("sharpness"), units=IMAGE,
        source="sharpness", optional=True, **_MAP,
    ),
    Score(
        "map_negative_log_likelihood", long_name="surprise at that map, mean over taxels [nats]",
        of=_on_map("negative_log_likelihood"), source="negative_log_likelihood", ratio=False, optional=True, **_MAP,
    ),
    Score(
        "map_crps", long_name="continuous ranked probability score of taxels, mean", of=_on_map("crps"), units=IMAGE,
        source="crps", optional=True, **_MAP,
    ),
    *_regions("map_", _on_map, dict(_MAP)),
    Score(
        "map_sparsification_gain", long_name="whether taxels err where it doubts: 1 perfectly, 0 at random",
        of=_on_map("sparsification_gain"), source="sparsification", ratio=False, optional=True, **_MAP,
    ),
)  # fmt: skip
"""Scores of doubt, each when it is named; of what is learned without any they are left out."""
