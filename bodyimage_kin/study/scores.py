"""The scores of a learned Jacobian and the facts of a recording: name, dimensions, unit, meaning and formula, in one place.

A score of one's own is a :class:`Score` at the top of a module; a study takes the object, or ``"package.module:NAME"``::

    def _worst(context):
        return max(one.max() for one in context.learned_jacobians.values())

    WORST = bk.study.Score("worst_entry", (), "largest entry of the learned Jacobian", _worst, units="m/rad")
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin._named import named_object
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.metrics import probes
from bodyimage_kin.study import maps
from bodyimage_kin.study.context import Context, answers, checked, floats
from bodyimage_kin.study.specs import plain_name
from bodyimage_kin.study.store import padded

PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
"""What a squared Jacobian error is the sum of (:class:`bodyimage_kin.metrics.Attribution`)."""
CAUSES = ("discretisation", "position", "circulation")
"""What the error of an integrated path is the sum of (:class:`bodyimage_kin.metrics.ErrorSplit`)."""
_ORACLE_SAMPLE = 64
"""Postures at which another backend's truth is held against Pinocchio's."""
_NEEDED = ("body", "skin", "truth", "learned", "use", "true_use", "tour", "maps")
_AT_PROBES = ("body", "learned")
_BY_POSTURE = ("probe", "posture")


@dataclass(frozen=True)
class Score:
    """One score of a learned Jacobian.

    Attributes:
        name: Its name in results.
        dims: Beside embodiment, recording, estimator and seed.
        long_name: What it is.
        of: Numbers (or text) of these dimensions, from the context.
        units: ``"1"`` where it has none.
        needs: What must be there (:attr:`Context.has`); where it is not, the score is left out.
        labels: Dimension -> names along it; of ``probe`` and ``axis`` they are known.
        source: Where its formula is.
        ratio: Whether it is positive and compared by ratios.
        optional: Whether it is computed only when a study asks for it by name, for it takes its time.
    """

    name: str
    dims: tuple[str, ...]
    long_name: str
    of: Callable[[Context], Any]
    units: str = "1"
    needs: tuple[str, ...] = ("learned",)
    labels: Mapping[str, tuple[str, ...]] | None = None
    source: str = ""
    ratio: bool = True
    optional: bool = False

    def __post_init__(self) -> None:
        plain_name("score", self.name)
        for need in self.needs:
            if need not in _NEEDED:
                raise UnknownName(f"need of score '{self.name}'", need, _NEEDED)

    @property
    def attributes(self) -> dict[str, str]:
        """As attributes of a variable."""
        found = {"long_name": self.long_name, "units": self.units}
        return found | ({"source": f"bodyimage_kin.metrics.{self.source}"} if self.source else {})


@dataclass(frozen=True)
class Fact(Score):
    """One fact of a recording, whatever is learned from it: a score without an estimator."""

    needs: tuple[str, ...] = ()


def resolve(asked: str | Score, folder: Path = Path()) -> Score:
    """The score or fact of a name.

    Args:
        asked: The object itself, a name of :data:`SCORES` or :data:`FACTS`, or ``"package.module:NAME"``.
        folder: Where a module may lie beside where Python looks.

    Raises:
        UnknownName: None of ours.
        InvalidConfig: Something that is no score.
    """
    if isinstance(asked, Score):
        return asked
    if not isinstance(asked, str):
        raise InvalidConfig(f"score {asked!r}: give its name, or a bk.study.Score")
    known = {**SCORES, **FACTS}
    if asked in known:
        return known[asked]
    if ":" not in asked:
        raise UnknownName("score", asked[:100], (*known, "package.module:NAME"))
    found = named_object("score", asked, folder)
    if not isinstance(found, Score):
        raise InvalidConfig(f"score {asked!r} is {type(found).__name__}; give a bk.study.Score")
    return found


def written(asked: str | Score, folder: Path = Path()) -> str:
    """How a score is named in a study's file: ours by name, any other as ``package.module:NAME``.

    Raises:
        UnknownName: None of ours.
        InvalidConfig: Something that is no score, or one that workers cannot find.
    """
    found = resolve(asked, folder)
    if isinstance(asked, str) or {**SCORES, **FACTS}.get(found.name) is found:
        return asked if isinstance(asked, str) else found.name
    module = sys.modules.get(found.of.__module__)
    names = [name for name, value in vars(module).items() if value is found] if module is not None else []
    if not names or found.of.__module__ == "__main__":
        raise InvalidConfig(f"score '{found.name}' cannot be found by workers; keep it at the top of its function's module")
    return f"{found.of.__module__}:{names[0]}"


def computed(context: Context, scores: Sequence[Score]) -> tuple[dict[str, Any], dict[str, str]]:
    """Scores of a context by name, and of those that are left out what they lack.

    Raises:
        InvalidConfig: A score of other dimensions than it says.
    """
    found: dict[str, Any] = {}
    lacking: dict[str, str] = {}
    for score in scores:
        if missing := [need for need in score.needs if need not in context.has]:
            lacking[score.name] = f"there is no {' and no '.join(one.replace('_', ' ') for one in missing)}"
            continue
        value = np.asarray(score.of(context))
        value = value if value.dtype.kind == "U" else value.astype(np.float64)
        if value.ndim != len(score.dims):
            raise InvalidConfig(f"score '{score.name}' has {value.ndim} dimensions, but says {score.dims}")
        found[score.name] = value
    return found, lacking


# Scores --------------------------------------------------------------------------------------------------------------


def _relative_error(context: Context) -> Any:
    return context.by_probe(metrics.pooled_relative_error)


def _relative_error_use(context: Context) -> Any:
    return context.by_probe(metrics.pooled_relative_error, context.motion_metric)


def _scale_free_error(context: Context) -> Any:
    return context.by_probe(metrics.pooled_scale_free_error, context.motion_metric)


def _of_attribution(*names: str) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        parts = context.attributions
        rows = [[getattr(parts[probe], name) for name in names] if probe in parts else None for probe in context.probes]
        values = padded(rows)
        return values if len(names) > 1 else values[:, 0]

    return of


def _relative_error_by_posture(context: Context) -> Any:
    return context.by_probe(metrics.relative_error, context.motion_metric)


def _scale_free_error_by_posture(context: Context) -> Any:
    return context.by_probe(metrics.scale_free_error, context.motion_metric)


def _critical_gain_by_posture(context: Context) -> Any:
    return context.by_probe(lambda J, Jh: metrics.critical_gain(metrics.servo_matrix(J, Jh)))


def _part_by_posture(part: str) -> Callable[[Context], Any]:
    """What each posture adds to a part of the attributed error, times their number."""

    def of(context: Context) -> Any:
        W, rows = context.motion_metric, []
        for probe in context.probes:
            if probe not in context.true_jacobians:
                rows.append(None)
                continue
            J, Jh = context.true_jacobians[probe], context.learned_jacobians[probe]
            scale = context.attributions[probe].best_scale
            residual = scale * Jh - J
            one = (1 - scale) * Jh if part == "scale" else residual - residual.mean(0)
            rows.append(np.einsum("nij,jk,nik->n", one, W, one) / np.einsum("nij,jk,nik->n", J, W, J).mean())
        return padded(rows)

    return of


def _displacement_error(context: Context) -> Any:
    body, tour = context.body, context.tour
    assert body is not None
    assert tour is not None
    q = tour["true_q"].values
    there = np.isfinite(q[:, :-1]).all(-1) & np.isfinite(q[:, 1:]).all(-1)
    before, dq = torch.from_numpy(q[:, :-1][there]), torch.from_numpy(np.diff(q, axis=1)[there])
    with torch.no_grad():
        linear = (body.hand_image_jacobian(before) @ dq[..., None])[..., 0].numpy()
    return metrics.displacement_error(
        checked("displacement on the tour", context.learned.displacement(before, dq), linear.shape), linear
    )


def _of_velocities(score: Callable[..., Any]) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        assert context.tour is not None
        return score(np.diff(context.tour["true_hand_image"].values, axis=1), np.diff(context.tour_path, axis=1))

    return of


def _trajectory_rmse(context: Context) -> Any:
    assert context.tour is not None
    return metrics.trajectory_rmse(context.tour["true_hand_image"].values, context.tour_path)


def _trajectory_split(context: Context) -> Float[np.ndarray, "cause"]:
    assert context.tour is not None
    rms = metrics.error_split(
        context.tour["true_q"].values,
        context.tour["true_hand_image"].values,
        lambda q, dq: floats(context.learned.displacement(torch.from_numpy(q), torch.from_numpy(dq))),
        lambda q: answers(context.learned.jacobian, q),
    ).rms
    return np.array([rms[cause] for cause in CAUSES])


def _basin_by_posture(context: Context) -> Any:
    body = context.body
    assert body is not None
    rows = [
        metrics.servo_basin(
            lambda q: answers(lambda part: body.hand_image(part, on_invisible="nan"), q),
            lambda q: answers(body.hand_image_jacobian, q),
            lambda q: answers(context.learned.jacobian, q),
            context.postures[name].numpy(),
            lower=body.felt_robot.lower.numpy(),
            upper=body.felt_robot.upper.numpy(),
        ).radius
        if isinstance(probe, probes.Face) and name in context.postures
        else np.empty(0)
        for name, probe in context.probes.items()
    ]
    return padded(rows)


def _touch_trajectory_rmse(context: Context) -> Any:
    assert context.use is not None
    return metrics.trajectory_rmse(context.use["true_hand_image"].values, context.hand.values)


def _of_maps(name: str) -> Callable[[Context], Any]:
    """Mean over the first maps of a score of the tactile map."""

    def of(context: Context) -> Any:
        assert context.body is not None
        truth = maps.true_map(context.body)
        return np.mean([maps.map_scores(one, truth)[name] for one in context.maps], axis=0)

    return of


def _map_error(context: Context) -> Any:
    pairs = zip(context.maps, context.direct_maps[0], strict=True)
    return np.mean([maps.relative_distance(one.tactile_map, direct) for one, direct in pairs])


def _posture_map_error(context: Context) -> Any:
    pairs = zip(context.maps, context.direct_maps[1], strict=True)
    return np.mean([maps.relative_distance(one.posture_map, direct) for one, direct in pairs])


_TOUR = ("body", "learned", "tour")
_MAPS = ("body", "maps")
SCORES: Mapping[str, Score] = {
    score.name: score
    for score in (
        # The tour comes first: of what explodes there, the reason is told that is easiest to see.
        Score(
            "displacement_error", (), "relative error of displacements on the tour", _displacement_error,
            needs=_TOUR, source="displacement_error",
        ),
        Score(
            "velocity_correlation", ("axis",), "correlation of velocities on the tour",
            _of_velocities(metrics.velocity_correlation), needs=_TOUR, source="velocity_correlation", ratio=False,
        ),
        Score(
            "velocity_nrmse", ("axis",), "velocity error over the range of the true one",
            _of_velocities(metrics.velocity_nrmse), needs=_TOUR, source="velocity_nrmse",
        ),
        Score(
            "trajectory_rmse", (), "position error of the integrated tour", _trajectory_rmse, "m",
            needs=_TOUR, source="trajectory_rmse",
        ),
        Score(
            "relative_error", ("probe",), "relative error of the Jacobian, identity metric: every joint alike",
            _relative_error, needs=_AT_PROBES, source="pooled_relative_error",
        ),
        Score(
            "relative_error_use", ("probe",), "relative error of the Jacobian in the motion's metric",
            _relative_error_use, needs=_AT_PROBES, source="pooled_relative_error",
        ),
        Score(
            "scale_free_error", ("probe",), "squared error left after the best scaling, motion's metric",
            _scale_free_error, needs=_AT_PROBES, source="pooled_scale_free_error",
        ),
        Score(
            "attribution", ("probe", "part"), "parts of the squared relative error, motion's metric",
            _of_attribution(*PARTS), needs=_AT_PROBES, labels={"part": PARTS}, source="attribute", ratio=False,
        ),
        Score(
            "best_scale", ("probe",), "best single scale of the estimate, motion's metric",
            _of_attribution("best_scale"), needs=_AT_PROBES, source="attribute", ratio=False,
        ),
        Score(
            "scale_along_truth", ("probe",), "squared error along the truth: the other projection of the scale",
            _of_attribution("scale_along_truth"), needs=_AT_PROBES, source="attribute", ratio=False,
        ),
        Score(
            "fit_seconds", (), "processor time to fit, the block's over its seeds; measured, so never twice the same",
            lambda context: context.seconds, "s",
        ),
        Score(
            "relative_error_by_posture", _BY_POSTURE, "relative error, motion's metric", _relative_error_by_posture,
            needs=_AT_PROBES, source="relative_error",
        ),
        Score(
            "scale_free_error_by_posture", _BY_POSTURE, "scale-free error, motion's metric",
            _scale_free_error_by_posture, needs=_AT_PROBES, source="scale_free_error",
        ),
        Score(
            "scale_by_posture", _BY_POSTURE, "what each posture adds to the part scale, times their number",
            _part_by_posture("scale"), needs=_AT_PROBES,
        ),
        Score(
            "variation_by_posture", _BY_POSTURE, "what each posture adds to the part variation, times their number",
            _part_by_posture("variation"), needs=_AT_PROBES,
        ),
        Score(
            "critical_gain_by_posture", _BY_POSTURE, "gain below which a sampled visual servo converges",
            _critical_gain_by_posture, needs=_AT_PROBES, source="critical_gain", ratio=False,
        ),
        Score(
            "trajectory_split", ("cause",),
            "parts of the position error of the tour integrated from true postures", _trajectory_split, "m",
            needs=_TOUR, labels={"cause": CAUSES}, source="error_split", ratio=False, optional=True,
        ),
        Score(
            "basin_by_posture", _BY_POSTURE,
            "distance on the screen from which a servo still converges; of probes of the face only", _basin_by_posture,
            "m", needs=(*_AT_PROBES, "skin"), source="servo_basin", ratio=False, optional=True,
        ),
        Score(
            "touch_trajectory_rmse", (), "position error of the integrated touching", _touch_trajectory_rmse, "m",
            needs=("true_use",), source="trajectory_rmse", optional=True,
        ),
        Score(
            "map_error", (), "distance from the map of direct sight, over that map's extent", _map_error,
            needs=(*_MAPS, "true_use"), optional=True,
        ),
        Score(
            "map_error_to_truth", (), "distance of the map from the true taxels, the kernel's share included",
            _of_maps("map_error_to_truth"), "m", needs=_MAPS, optional=True,
        ),
        Score(
            "map_topological_error", (), "taxels out of order with a neighbour", _of_maps("map_topological_error"),
            needs=_MAPS, source="topological_error", ratio=False, optional=True,
        ),
        Score(
            "map_span", ("axis",), "extent of the map over the true one", _of_maps("map_span"),
            needs=_MAPS, source="span", ratio=False, optional=True,
        ),
        Score(
            "map_disparity", (), "squared error of the map left after the best similarity", _of_maps("map_disparity"),
            needs=_MAPS, source="procrustes", optional=True,
        ),
        Score(
            "map_folded_cells", (), "cells of the map turned over or flattened", _of_maps("map_folded_cells"),
            needs=_MAPS, source="folded_cells", ratio=False, optional=True,
        ),
        Score(
            "posture_map_error", (), "distance from the posture map of direct sight, over that map's extent",
            _posture_map_error, needs=(*_MAPS, "true_use"), optional=True,
        ),
    )
}  # fmt: skip
"""Name -> score; those by posture are kept on request, optional ones when they are named."""


# Facts ---------------------------------------------------------------------------------------------------------------


def _of_excitation(name: str) -> Callable[[Context], Any]:
    return lambda context: getattr(context.excitation, name)


def _distance(index: int) -> Callable[[Context], Any]:
    """How far each posture of each probe is from training, in joint space or of the hand."""

    def of(context: Context) -> Any:
        assert context.body is not None
        away = {
            name: probes.distances(context.body, context.seen, q)[index] for name, q in context.postures.items()
        }
        return padded([away.get(name) for name in context.probes])

    return of


def _mean_distance(index: int) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        rows = _distance(index)(context)
        return padded([one[np.isfinite(one)].mean() if np.isfinite(one).any() else None for one in rows])

    return of


def _depth_ratio(context: Context) -> Any:
    assert context.body is not None
    return metrics.depth_ratio(context.body, context.seen)


def _of_direct_maps(name: str) -> Callable[[Context], Any]:
    def of(context: Context) -> Any:
        assert context.body is not None
        truth = maps.true_map(context.body)
        return np.mean([maps.map_scores(one, truth)[name] for one in context.maps], axis=0)

    return of


_DIRECT = (*_MAPS, "true_use")
_UNITS = ("unit_row", "unit_column")
FACTS: Mapping[str, Fact] = {
    fact.name: fact
    for fact in (
        Fact("excitation", ("direction",), "G_train v = mu G_use v", _of_excitation("eigenvalues"), needs=("use",)),
        Fact(
            "max_oracle_difference", (), "largest difference of the truth from Pinocchio's",
            lambda context: context.oracle_difference(_ORACLE_SAMPLE), "m/rad", needs=("body",),
        ),
        Fact(
            "mahalanobis_distance", ("probe",), "distance from training in its joint space, mean over postures",
            _mean_distance(0), needs=("body",),
        ),
        Fact(
            "hand_distance", ("probe",), "distance of the hand from where it was in training, mean over postures",
            _mean_distance(1), "m", needs=("body",),
        ),
        Fact(
            "mahalanobis_distance_by_posture", _BY_POSTURE, "distance from training in its joint space", _distance(0),
            needs=("body",),
        ),
        Fact(
            "hand_distance_by_posture", _BY_POSTURE, "distance of the hand from where it was in training",
            _distance(1), "m", needs=("body",),
        ),
        Fact(
            "depth_ratio", (), "mean depth of the hand in training over that on the face", _depth_ratio,
            needs=("body", "skin"), source="depth_ratio", optional=True,
        ),
        Fact(
            "motion_metric", ("joint", "other_joint"), "mean(dq dq') of the motion of use",
            lambda context: context.motion_metric, "rad^2", source="motion_metric", optional=True,
        ),
        Fact(
            "excited_motion", ("joint", "direction"), "v of G_train v = mu G_use v", _of_excitation("eigenvectors"),
            "1/rad", needs=("use",), optional=True,
        ),
        Fact(
            "direct_map_error_to_truth", (), "distance of the map of direct sight from the true taxels: the kernel's share",
            _of_direct_maps("map_error_to_truth"), "m", needs=_DIRECT, optional=True,
        ),
        Fact(
            "direct_map_span", ("axis",), "extent of the map of direct sight over the true one",
            _of_direct_maps("map_span"), needs=_DIRECT, optional=True,
        ),
        Fact(
            "direct_map_topological_error", (), "taxels of the map of direct sight out of order with a neighbour",
            _of_direct_maps("map_topological_error"), needs=_DIRECT, optional=True,
        ),
        Fact(
            "direct_map", ("first_map", "row", "column", "axis"), "map of direct sight",
            lambda context: padded([one.tactile_map for one in context.maps]), "m", needs=_DIRECT, optional=True,
        ),
        Fact(
            "direct_posture_map", ("first_map", *_UNITS, "axis"), "posture map of direct sight",
            lambda context: padded([one.posture_map for one in context.maps]), "m", needs=_DIRECT, optional=True,
        ),
        Fact(
            "posture_units", (*_UNITS, "joint"), "representative postures of the posture map",
            lambda context: context.posture_som.postures, "rad", needs=("maps",), optional=True,
        ),
        Fact(
            "posture_scale", ("joint",), "spread of each joint over the touches",
            lambda context: context.posture_som.scale, "rad", needs=("maps",), optional=True,
        ),
    )
}  # fmt: skip
"""Name -> fact of a recording. Estimators may be told them (:attr:`Row.told`)."""


def _default(known: Mapping[str, Score], per_posture: bool) -> tuple[str, ...]:
    kept = (one for one in known.values() if not one.optional and (per_posture or "posture" not in one.dims))
    return tuple(one.name for one in kept)


def default_scores(per_posture: bool = False) -> tuple[str, ...]:
    """Names of the scores that a study keeps unless it says otherwise."""
    return _default(SCORES, per_posture)


def default_facts(per_posture: bool = False, with_maps: bool = False) -> tuple[str, ...]:
    """Names of the facts that a study keeps unless it says otherwise."""
    of_maps = [name for name in FACTS if name.startswith("direct_map_")] if with_maps else []
    return (*_default(FACTS, per_posture), *of_maps)


MAP_SCORES = tuple(name for name in SCORES if "map_" in name or name.startswith("touch_"))
"""Scores for which touches are integrated and, but for the first, maps are learned (:mod:`bodyimage_kin.study.maps`)."""
SHARED_MAPS = ("posture_units", "posture_scale", "direct_map", "direct_posture_map")
"""Facts that are computed once a recording for all rows, where maps are learned."""


def need_maps(names: Collection[str], folder: Path = Path()) -> bool:
    """Whether maps are to be learned for any of these scores."""
    return any("maps" in resolve(name, folder).needs for name in names)
