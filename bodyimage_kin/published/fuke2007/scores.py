"""Scores that the experiment asks for beside those of every study, and arrays that its figures draw."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import scipy.stats
import torch
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body import Embodiment
from bodyimage_kin.body_image import BodyImage, expected_map
from bodyimage_kin.estimators import pairs
from bodyimage_kin.recordings import first_taxel, motions
from bodyimage_kin.study import Context, Fact, Score
from bodyimage_kin.study.maps import true_map

__all__ = [
    "DISPARITY",
    "EDGE_CORRELATION",
    "FACTS",
    "FOLDED_CELLS",
    "IDENTITY_ERROR_BY_POSTURE",
    "JACOBIAN_CHANGE",
    "LOOP_DRIFT",
    "MAP_SCALE",
    "POSTURE_DISPARITY",
    "POSTURE_MAP",
    "POSTURE_RMSE",
    "POSTURE_SCALE",
    "POSTURE_SPAN",
    "QUANTIZATION",
    "RELATIONS_KEPT",
    "SCORES",
    "SPANS",
    "TACTILE_MAPS",
    "TOPOGRAPHIC",
    "TOPOLOGICAL_ERRORS",
    "TOUR_PATH",
    "TRAINING_RESIDUAL",
    "true_posture_map",
]

_LEARNED, _TOUR, _MAPS = ("learned",), ("body", "skin", "learned", "tour"), ("body", "maps", "use")


def _body(context: Context) -> Embodiment:
    assert context.body is not None
    return context.body


def _identity_error_by_posture(context: Context) -> Any:
    return context.by_probe(metrics.relative_error)


def _training_residual(context: Context) -> Any:
    """RMS of what the Jacobian leaves of the displacements it was trained on, relative to theirs."""
    data = pairs(context.experience)
    with torch.no_grad():
        return metrics.displacement_error(context.learned.displacement(data.q, data.dq).numpy(), data.dr.numpy())


def _loop_drift(context: Context) -> Any:
    """How far the estimate moves in one closed loop of postures: of a Jacobian with a potential, what steps leave."""
    loop = _closed_loop(_body(context))
    dq = loop[1:] - loop[:-1]
    at = loop[:-1] + dq / 2 if context.row.method == "midpoint" else loop[:-1]
    with torch.no_grad():
        return float(torch.linalg.vector_norm(context.learned.displacement(at, dq).sum(0)))


@lru_cache(maxsize=4)
def _closed_loop(body: Embodiment) -> Float[torch.Tensor, "time p"]:
    """Postures over the landmarks of the face and back to the first: each place has one posture, so the loop closes."""
    stops = [*motions.TOUR, motions.TOUR[0]]
    path = motions.FaceTour(landmarks=tuple(stops)).path(body, np.random.default_rng(0), 0.1)
    postures, _ = body.reach(torch.from_numpy(path.centres))
    return torch.cat([postures, postures[:1]])


def _relations_kept(context: Context) -> Any:
    """Share of the relations between landmarks (left of, above; true by a centimetre) that an estimated tour keeps."""
    assert context.tour is not None
    body = _body(context)
    true, path = context.tour["true_hand_image"].values[0], context.tour_path[0]
    landmarks = body.require_skin().landmarks
    places = true_map(body).reshape(-1, body.m)[[landmarks[name] for name in sorted(set(motions.TOUR))]]
    visits = [int(np.linalg.norm(true - place, axis=1).argmin()) for place in places]
    apart, thought = places[:, None] - places[None], path[visits][:, None] - path[visits][None]
    holds = np.abs(apart) > 0.01
    return float(np.mean(np.sign(apart[holds]) == np.sign(thought[holds])))


def _jacobian_change(context: Context) -> Any:
    """How much the mean true Jacobian changes from the circle to the face, in the motion's metric."""
    seen, touching = (context.true_jacobians[probe].mean(0) for probe in ("on_circle", "on_face"))
    return metrics.pooled_relative_error(touching[None], seen[None], context.motion_metric)


def _snapshots(learned: BodyImage) -> Float[np.ndarray, "snapshots rows columns m"]:
    return np.asarray(learned.history["tactile_maps"])


def _topological_errors(context: Context) -> Any:
    return np.array([[metrics.topological_error(map) for map in _snapshots(one)] for one in context.maps], dtype=float)


def _spans(context: Context) -> Any:
    truth = true_map(_body(context))
    return np.array([metrics.span(map, truth) for map in _snapshots(context.maps[0])])


def _of_first_map(name: str) -> Any:
    """A score of the last tactile map from the first of the first maps."""

    def of(context: Context) -> Any:
        return metrics.scores(context.maps[0].tactile_map, true_map(_body(context)))[name]

    return of


def _edge_correlation(context: Context) -> Any:
    """Spearman's correlation over taxels: touch counts against what is left of the map after its best similarity fit.

    The map is held against the kernel average of the true places over the same touches, so that the kernel's own share
    of the distortion does not count.
    """
    skin, truth, learned = _body(context).require_skin(), true_map(_body(context)), context.maps[0]
    expected = expected_map(truth.reshape(-1, truth.shape[-1]), first_taxel(context.felt_use)[0], skin)
    fit = metrics.procrustes(learned.tactile_map, expected)
    taxels = tuple(range(truth.ndim - 1))
    centred = (expected - expected.mean(taxels)) @ fit.rotation.T * fit.scale
    left = np.linalg.norm(learned.tactile_map - learned.tactile_map.mean(taxels) - centred, axis=-1).ravel()
    counts = np.asarray(learned.touch_counts).ravel()
    if not (np.ptp(left) > 0 and np.ptp(counts) > 0):
        return float("nan")
    return float(scipy.stats.spearmanr(counts, left).statistic)


def true_posture_map(body: Embodiment, postures: Float[np.ndarray, "rows columns p"]) -> Float[np.ndarray, "r c m"]:
    """Image of the hand in each representative posture, in the camera's unit; NaN where it has none."""
    with torch.no_grad():
        return body.hand_image(torch.from_numpy(postures), on_invisible="nan").numpy()


def _of_posture_map(name: str) -> Any:
    """A score of the posture map against the true image of each unit's posture, or of its units against the touches."""

    def of(context: Context) -> Any:
        learned, som = context.maps[0], context.posture_som
        true = true_posture_map(_body(context), learned.postures)
        if name == "rmse":
            return metrics.trajectory_rmse(
                true.reshape(-1, true.shape[-1]), learned.posture_map.reshape(-1, true.shape[-1])
            )
        if name == "span":
            return metrics.span(learned.posture_map, true)
        if name in ("disparity", "scale"):
            return getattr(metrics.procrustes(learned.posture_map, true), name)
        felt = context.felt_use
        touching = felt["q"].values[0][first_taxel(felt)[0] >= 0]
        return getattr(metrics, name)(learned.postures / som.scale, touching / som.scale)

    return of


_ROOM = ("unit_row", "unit_column", "axis")

# Each stands by its own name, so that workers find it.
IDENTITY_ERROR_BY_POSTURE = Score(
    "identity_error_by_posture", ("probe", "posture"), "relative error, every joint alike",
    _identity_error_by_posture, needs=("body", "learned"), source="relative_error",
)  # fmt: skip
TRAINING_RESIDUAL = Score(
    "training_residual", (), "relative residual on the training displacements", _training_residual, needs=_LEARNED
)
LOOP_DRIFT = Score(
    "loop_drift", (), "drift in one closed loop over the face", _loop_drift, "m", needs=("body", "skin", "learned")
)
RELATIONS_KEPT = Score("relations_kept", (), "relations of landmarks that the tour keeps", _relations_kept, needs=_TOUR)
TOUR_PATH = Score(
    "tour_path", ("sample", "axis"), "integrated hand image on the tour", lambda context: context.tour_path[0], "m",
    needs=_TOUR, ratio=False,
)  # fmt: skip
TOPOLOGICAL_ERRORS = Score(
    "topological_errors", ("first_map", "snapshot"), "taxels out of order with a neighbour", _topological_errors,
    needs=_MAPS, ratio=False,
)  # fmt: skip
SPANS = Score("spans", ("snapshot", "axis"), "extent of the map over the true one", _spans, needs=_MAPS, ratio=False)
TACTILE_MAPS = Score(
    "tactile_maps", ("snapshot", "row", "column", "axis"), "the tactile map as it is learned",
    lambda context: _snapshots(context.maps[0]), "m", needs=_MAPS, ratio=False,
)  # fmt: skip
FOLDED_CELLS = Score("folded_cells", (), "cells turned over or flattened", _of_first_map("folded_cells"), needs=_MAPS)
DISPARITY = Score("disparity", (), "what the best similarity leaves", _of_first_map("disparity"), needs=_MAPS)
MAP_SCALE = Score("map_scale", (), "scale of the best similarity", _of_first_map("scale"), needs=_MAPS)
EDGE_CORRELATION = Score(
    "edge_correlation", (), "touch counts against the map's error", _edge_correlation, needs=_MAPS, ratio=False
)
POSTURE_MAP = Score(
    "posture_map", _ROOM, "the posture map", lambda context: context.maps[0].posture_map, "m", needs=_MAPS, ratio=False
)
POSTURE_RMSE = Score("posture_rmse", (), "error of the posture map", _of_posture_map("rmse"), "m", needs=_MAPS)
POSTURE_SPAN = Score("posture_span", ("axis",), "extent of the posture map", _of_posture_map("span"), needs=_MAPS)
POSTURE_DISPARITY = Score("posture_disparity", (), "of the posture map", _of_posture_map("disparity"), needs=_MAPS)
POSTURE_SCALE = Score("posture_map_scale", (), "of the posture map", _of_posture_map("scale"), needs=_MAPS)
QUANTIZATION = Score(
    "quantization_error", (), "of the representative postures", _of_posture_map("quantization_error"), needs=_MAPS
)
TOPOGRAPHIC = Score(
    "topographic_error", (), "of the representative postures", _of_posture_map("topographic_error"), needs=_MAPS
)
JACOBIAN_CHANGE = Fact(
    "jacobian_change", (), "change of the mean true Jacobian from circle to face, motion's metric", _jacobian_change,
    needs=("body", "skin"),
)  # fmt: skip

SCORES: tuple[str | Score, ...] = (
    "displacement_error", "velocity_correlation", "velocity_nrmse", "trajectory_rmse", "relative_error",
    "relative_error_use", "attribution", "scale_along_truth", IDENTITY_ERROR_BY_POSTURE, TRAINING_RESIDUAL, LOOP_DRIFT,
    RELATIONS_KEPT, TOUR_PATH, TOPOLOGICAL_ERRORS, SPANS, TACTILE_MAPS, FOLDED_CELLS, DISPARITY, MAP_SCALE,
    EDGE_CORRELATION, POSTURE_MAP, POSTURE_RMSE, POSTURE_SPAN, POSTURE_DISPARITY, POSTURE_SCALE, QUANTIZATION,
    TOPOGRAPHIC,
)  # fmt: skip
"""Names of a study's own scores, and further ones."""
FACTS: tuple[str | Fact, ...] = (
    "excitation", "hand_distance_by_posture", "depth_ratio", "posture_units", "posture_scale", "direct_map",
    "direct_posture_map", JACOBIAN_CHANGE,
)  # fmt: skip
"""Likewise of the recordings."""
