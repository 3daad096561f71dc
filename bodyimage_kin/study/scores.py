"""The scores of a learned Jacobian: name, dimensions, unit, meaning and formula, in one place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin._arrays import as_float_array
from bodyimage_kin.estimators import LearnedImage
from bodyimage_kin.metrics import probes
from bodyimage_kin.study import maps
from bodyimage_kin.study.answers import answers, checked, jacobians
from bodyimage_kin.study.context import IMAGE, Context, LeftOut, Score
from bodyimage_kin.study.doubt import DOUBT
from bodyimage_kin.study.held_out import foretold, noise_of
from bodyimage_kin.study.store import padded

__all__ = ["CAUSES", "HELD_OUT", "MAP_SCORES", "PARTS", "SCORES", "displacement_error_along", "of_maps"]

PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
"""What a squared Jacobian error is the sum of (:class:`bodyimage_kin.metrics.Attribution`)."""
CAUSES = ("discretisation", "position", "circulation")
"""What the error of an integrated path is the sum of (:class:`bodyimage_kin.metrics.ErrorSplit`)."""
_AT_PROBES = ("body", "learned")
_BY_POSTURE = ("probe", "posture")
_TOUR = ("body", "learned", "tour")
_HELD_OUT = ("learned", "estimator")
_MAPS = ("body", "maps")


def _relative_error(context: Context) -> Any:
    return context.by_probe(metrics.pooled_relative_error)


def _relative_error_use(context: Context) -> Any:
    return context.by_probe(metrics.pooled_relative_error, context.motion_metric)


def _relative_error_moved(context: Context) -> Any:
    body = context.body
    assert body is not None
    q = probes.probe_postures(probes.Training(), body, context.seen)
    with torch.no_grad():
        J, Jh = (jacobians("jacobian", of, q, body.m) for of in (body.hand_image_jacobian, context.learned.jacobian))
    spectrum = metrics.local_spectrum(q, noise=float(context.seen.attrs.get("encoder_noise", 0.0)))
    return metrics.pooled_relative_error(spectrum.restrict(J), spectrum.restrict(Jh))


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
        W = context.motion_metric
        rows: list[Any] = []
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


def displacement_error_along(context: Context, moved: xr.Dataset | None, where: str) -> float:
    """Relative error of learned displacements over the true steps of a recording.

    Args:
        context: Of what was learned.
        moved: The recording, with the truth.
        where: What it is, for an error.

    Raises:
        WrongResult: What was learned answers in other shapes, or not in finite numbers.
    """
    assert context.body is not None
    assert moved is not None
    q = moved["true_q"].values
    there = np.isfinite(q[:, :-1]).all(-1) & np.isfinite(q[:, 1:]).all(-1)
    before, dq = torch.from_numpy(q[:, :-1][there]), torch.from_numpy(np.diff(q, axis=1)[there])
    with torch.no_grad():
        linear = (context.body.hand_image_jacobian(before) @ dq[..., None])[..., 0].numpy()
    foreseen = checked(f"displacement {where}", context.learned.displacement(before, dq), linear.shape)
    return metrics.displacement_error(foreseen, linear)


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
        lambda q, dq: as_float_array(context.learned.displacement(torch.from_numpy(q), torch.from_numpy(dq))),
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


def of_maps(name: str) -> Callable[[Context], Any]:
    """Mean over the first maps of a score of the tactile map (:func:`bodyimage_kin.study.maps.map_scores`)."""

    def of(context: Context) -> Any:
        assert context.body is not None
        truth = maps.true_map(context.body)
        return np.mean([maps.map_scores(one, truth)[name] for one in context.maps], axis=0)

    return of


def _map_error(context: Context) -> Any:
    pairs = zip(context.maps, context.direct_maps[0], strict=True)
    return np.mean([maps.relative_distance(one.tactile_map.reshape(direct.shape), direct) for one, direct in pairs])


def _posture_map_error(context: Context) -> Any:
    pairs = zip(context.maps, context.direct_maps[1], strict=True)
    return np.mean([maps.relative_distance(one.posture_map, direct) for one, direct in pairs])


def _held_out(kind: Literal["pair", "image"], name: str) -> Callable[[Context], Any]:
    """Of what was learned without each fold, on that fold; needs neither a body nor a truth."""

    def of(context: Context) -> Any:
        if kind == "image" and not isinstance(context.learned, LearnedImage):
            raise LeftOut("what is learned gives no hand image, only how it changes")
        noise = noise_of(context.experience)
        if "corrected" in name and np.isnan(noise):
            raise LeftOut("no posture is repeated (variable 'repeat'), so the noise of an image is not known")
        key = f"{kind}s foretold"
        if key not in context.shared:
            context.shared[key] = foretold(kind, context.learned_by_fold, context.folds, noise)
        return getattr(context.shared[key], name)

    return of


SCORES: Mapping[str, Score] = {
    score.name: score
    for score in (
        # What is seen without a truth, of every recording; blocks are hidden in turn, and each fold is learned anew.
        Score(
            "pair_error", (), "error of foretold displacements between neighbouring postures, blocks hidden in turn",
            _held_out("pair", "error"), IMAGE, needs=_HELD_OUT, source="pair_error", optional=True,
        ),
        Score(
            "pair_error_relative", (), "that error over the displacements observed: who foretells no motion has 1",
            _held_out("pair", "relative"), needs=_HELD_OUT, source="pair_error", optional=True,
        ),
        Score(
            "pair_error_relative_corrected", (), "relative error of foretold displacements, noise of images taken off",
            _held_out("pair", "relative_corrected"), needs=_HELD_OUT, source="pair_error", optional=True,
        ),
        Score(
            "image_error", (), "error of foretold hand images, blocks hidden in turn", _held_out("image", "error"),
            IMAGE, needs=_HELD_OUT, source="image_error", optional=True,
        ),
        Score(
            "image_error_relative", (), "that error over the spread of the images: who foretells their mean has 1",
            _held_out("image", "relative"), needs=_HELD_OUT, source="image_error", optional=True,
        ),
        # The tour comes first: of what explodes there, the reason is told that is easiest to see.
        Score(
            "displacement_error", (), "relative error of displacements on the tour",
            lambda context: displacement_error_along(context, context.tour, "on the tour"), needs=_TOUR,
            source="displacement_error",
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
            "trajectory_rmse", (), "position error of the integrated tour", _trajectory_rmse, IMAGE,
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
            "relative_error_moved", (), "relative error in training, in the directions in which the joints moved there",
            _relative_error_moved, needs=_AT_PROBES, source="local_spectrum", optional=True,
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
            "parts of the position error of the tour integrated from true postures", _trajectory_split, IMAGE,
            needs=_TOUR, labels={"cause": CAUSES}, source="error_split", ratio=False, optional=True,
        ),
        Score(
            "basin_by_posture", _BY_POSTURE,
            "distance on the screen from which a servo still converges; of probes of the face only", _basin_by_posture,
            IMAGE, needs=(*_AT_PROBES, "skin"), source="servo_basin", ratio=False, optional=True,
        ),
        Score(
            "touch_trajectory_rmse", (), "position error of the integrated touching", _touch_trajectory_rmse, IMAGE,
            needs=("true_use",), source="trajectory_rmse", optional=True,
        ),
        Score(
            "map_error", (), "distance from the map of direct sight, over that map's extent", _map_error,
            needs=(*_MAPS, "true_use"), optional=True,
        ),
        Score(
            "map_error_to_truth", (), "distance of the map from the true taxels, the kernel's share included",
            of_maps("map_error_to_truth"), IMAGE, needs=_MAPS, optional=True,
        ),
        Score(
            "map_topological_error", (), "taxels out of order with a neighbour", of_maps("map_topological_error"),
            needs=_MAPS, source="topological_error", ratio=False, optional=True,
        ),
        Score(
            "map_span", ("axis",), "extent of the map over the true one", of_maps("map_span"),
            needs=_MAPS, source="span", ratio=False, optional=True,
        ),
        Score(
            "map_disparity", (), "squared error of the map left after the best similarity", of_maps("map_disparity"),
            needs=_MAPS, source="procrustes", optional=True,
        ),
        Score(
            "map_folded_cells", (), "cells of the map turned over or flattened", of_maps("map_folded_cells"),
            needs=_MAPS, source="folded_cells", ratio=False, optional=True,
        ),
        Score(
            "posture_map_error", (), "distance from the posture map of direct sight, over that map's extent",
            _posture_map_error, needs=(*_MAPS, "true_use"), optional=True,
        ),
        *DOUBT,
    )
}  # fmt: skip
"""Name -> score; those by posture are kept on request, optional ones when they are named."""
HELD_OUT = tuple(name for name, score in SCORES.items() if score.needs == _HELD_OUT)
"""Scores that need no truth; studies keep them of recordings that they were handed."""
MAP_SCORES = tuple(
    name for name, one in SCORES.items() if ("map_" in name or name.startswith("touch_")) and one not in DOUBT
)
"""Scores for which touches are integrated and, but for the first, maps are learned; without those of doubt."""
