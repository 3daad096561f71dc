"""Scores of one Jacobian, and of the maps that one source of hand images leads to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.stats
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body_image import BodyImage, expected_map, integrate
from bodyimage_kin.estimators import LearnedJacobian, pairs
from bodyimage_kin.published.fuke2007.conditions import PARTS, PROBES
from bodyimage_kin.published.fuke2007.scene import Scene
from bodyimage_kin.recordings import experience, first_taxel, motions

GAMMA = 40.0
"""Scaling factor of the taxels' activation (Table 1)."""
_SNAPSHOTS = (0.0, 0.15, 0.3, 0.45, 0.6, 0.9, 1.0)
"""Shares of all map steps at which maps are kept: 0, 1200, 2400, 3600, 4800, 7200 and 8000 of 8000 (Fig. 10)."""


@dataclass(frozen=True, eq=False)
class Scored:
    """What came of one Jacobian in one cell.

    Attributes:
        velocity_correlation: (m,) on the tour.
        velocity_nrmse: (m,) on the tour.
        displacement_error: On the tour.
        trajectory_rmse: On the tour [m].
        relations_kept: Share of the tour's spatial relations between landmarks that the estimated path keeps.
        loop_drift: How far the estimate moves in one closed loop of postures over the face [m].
        jacobian_relative_error: Probe -> pooled relative error, every joint alike.
        jacobian_relative_error_use: The same in the unit metric of the touching motion.
        attribution: Probe -> part -> share of the squared error in that metric.
        error_by_posture: Probe -> (postures,) relative error, every joint alike.
        training_residual: What the Jacobian leaves of the displacements it was trained on, relative.
        tour_image: (time, m) integrated hand image on the tour [m].
    """

    velocity_correlation: Float[np.ndarray, "m"]
    velocity_nrmse: Float[np.ndarray, "m"]
    displacement_error: float
    trajectory_rmse: float
    relations_kept: float
    loop_drift: float
    jacobian_relative_error: Mapping[str, float]
    jacobian_relative_error_use: Mapping[str, float]
    attribution: Mapping[str, Mapping[str, float]]
    error_by_posture: Mapping[str, np.ndarray]
    training_residual: float
    tour_image: Float[np.ndarray, "time m"]


@dataclass(frozen=True, eq=False)
class Mapped:
    """The maps that one source of hand images led to.

    Attributes:
        steps: Steps of the snapshots.
        maps: (snapshots, rows, columns, m) tactile maps [m].
        topological_errors: One a snapshot.
        spans: (snapshots, m).
        final: Scores of the last tactile map.
        edge_correlation: Spearman's rank correlation over taxels, touch counts against the map's error.
        posture_map: (8, 8, m) [m].
        posture_scores: Scores of the posture map.
    """

    steps: Sequence[int]
    maps: Float[np.ndarray, "snapshots rows columns m"]
    topological_errors: Sequence[int]
    spans: Float[np.ndarray, "snapshots m"]
    final: Mapping[str, Any]
    edge_correlation: float
    posture_map: Float[np.ndarray, "8 8 m"]
    posture_scores: Mapping[str, Any]


def score(scene: Scene, learned: LearnedJacobian, method: str = "euler") -> Scored:
    """Scores of a Jacobian on the tour, on a closed loop, and at the probes."""
    body, tour = scene.body, scene.tour
    image = tour["true_hand_image"].values[0]
    q = torch.from_numpy(tour["true_q"].values[0])
    dq = q[1:] - q[:-1]
    with torch.no_grad():
        foreseen = learned.displacement(q[:-1], dq).numpy()
        linear = (body.hand_image_jacobian(q[:-1]) @ dq[..., None])[..., 0].numpy()
        estimated = {probe: learned.jacobian(postures).numpy() for probe, postures in scene.probes.items()}
        drift = torch.linalg.vector_norm(_around(learned, scene.loop, method))
    integrated = integrate(experience(tour), learned, reset="none", initial=image[0], method=method).values[0]
    velocity, estimated_velocity = np.diff(image, axis=0), np.diff(integrated, axis=0)
    W, P = scene.excitation.motion_metric, scene.excitation.projector()
    parts = {probe: metrics.attribute(scene.truth[probe], estimated[probe], W, P) for probe in PROBES}
    return Scored(
        velocity_correlation=metrics.velocity_correlation(velocity, estimated_velocity),
        velocity_nrmse=metrics.velocity_nrmse(velocity, estimated_velocity),
        displacement_error=metrics.displacement_error(foreseen, linear),
        trajectory_rmse=metrics.trajectory_rmse(image, integrated),
        relations_kept=_relations_kept(scene, integrated),
        loop_drift=float(drift),
        jacobian_relative_error={
            probe: metrics.pooled_relative_error(scene.truth[probe], estimated[probe]) for probe in PROBES
        },
        jacobian_relative_error_use={
            probe: metrics.pooled_relative_error(scene.truth[probe], estimated[probe], W) for probe in PROBES
        },
        attribution={probe: {part: getattr(found, part) for part in PARTS} for probe, found in parts.items()},
        error_by_posture={probe: metrics.relative_error(scene.truth[probe], estimated[probe]) for probe in PROBES},
        training_residual=_training_residual(scene, learned),
        tour_image=integrated,
    )


def learn_map(
    scene: Scene, hand: xr.DataArray, seed: int | None = None, snapshots: Sequence[float] = _SNAPSHOTS
) -> Mapped:
    """The maps that these hand images lead to, and their scores at each snapshot.

    Args:
        scene: What is touched.
        hand: (trial, time, m) hand images [m].
        seed: Of the first maps; None: the scene's.
        snapshots: Shares of all steps at which the tactile map is kept.
    """
    steps = scene.lesson.felt.sizes["time"]
    kept = [round(share * steps) for share in snapshots]
    learned = scene.lesson.learn(hand, scene.seed if seed is None else seed, kept, gamma=GAMMA)
    maps = np.asarray(learned.history["tactile_maps"])
    return Mapped(
        steps=[int(step) for step in learned.history["steps"]],
        maps=maps,
        topological_errors=[metrics.topological_error(map) for map in maps],
        spans=np.array([metrics.span(map, scene.true_map) for map in maps]),
        final=metrics.scores(maps[-1], scene.true_map),
        edge_correlation=_edge_correlation(scene, maps[-1], learned.touch_counts),
        posture_map=learned.posture_map,
        posture_scores=_posture_scores(scene, learned),
    )


def _training_residual(scene: Scene, learned: LearnedJacobian) -> float:
    """RMS of what the Jacobian leaves of the displacements it was trained on, relative to theirs."""
    data = pairs(experience(scene.circle))
    with torch.no_grad():
        return metrics.displacement_error(learned.displacement(data.q, data.dq).numpy(), data.dr.numpy())


def _around(learned: LearnedJacobian, loop: Float[torch.Tensor, "time p"], method: str) -> Float[torch.Tensor, "m"]:
    """Sum of the displacements along a loop [m]: of a Jacobian that has a potential, only what long steps leave."""
    dq = loop[1:] - loop[:-1]
    at = loop[:-1] + dq / 2 if method == "midpoint" else loop[:-1]
    return learned.displacement(at, dq).sum(0)


def _relations_kept(scene: Scene, integrated: Float[np.ndarray, "time m"]) -> float:
    """Share of the relations between landmarks (left of, above; true by a centimetre) that an estimated tour keeps."""
    true = scene.tour["true_hand_image"].values[0]
    places = scene.true_map.reshape(-1, scene.body.m)[
        [scene.body.require_skin().landmarks[name] for name in sorted(set(motions.TOUR))]
    ]
    visits = [int(np.linalg.norm(true - place, axis=1).argmin()) for place in places]
    apart = places[:, None] - places[None]
    thought = integrated[visits][:, None] - integrated[visits][None]
    holds = np.abs(apart) > 0.01
    return float(np.mean(np.sign(apart[holds]) == np.sign(thought[holds])))


def _edge_correlation(scene: Scene, map: Float[np.ndarray, "rows columns m"], touches: np.ndarray) -> float:
    """Spearman's correlation over taxels: touch counts against what is left of the map after its best similarity fit.

    The map is held against the kernel average of the true places over the same touches, so that the kernel's own share
    of the distortion does not count.
    """
    taxels = first_taxel(scene.touch)[0]
    expected = expected_map(scene.true_map.reshape(-1, scene.body.m), taxels, scene.true_map.shape[:2])
    fit = metrics.procrustes(true=expected, map=map)
    centred = (expected - expected.mean((0, 1))) @ fit.rotation.T * fit.scale
    left = np.linalg.norm(map - map.mean((0, 1)) - centred, axis=-1).ravel()
    counts = np.asarray(touches).ravel()
    if not (np.ptp(left) > 0 and np.ptp(counts) > 0):
        return float("nan")
    return float(scipy.stats.spearmanr(counts, left).statistic)


def _posture_scores(scene: Scene, learned: BodyImage) -> dict[str, Any]:
    """Scores of the posture map against the true image of each unit's posture."""
    with torch.no_grad():
        true = scene.body.hand_image(torch.from_numpy(learned.postures), on_invisible="nan").numpy()
    fit = metrics.procrustes(true=true, map=learned.posture_map)
    touching = scene.touch["true_q"].values[0][first_taxel(scene.touch, truth=True)[0] >= 0]
    units, samples = learned.postures / scene.lesson.posture_som.scale, touching / scene.lesson.posture_som.scale
    return {
        "rmse": metrics.trajectory_rmse(true.reshape(-1, scene.body.m), learned.posture_map.reshape(-1, scene.body.m)),
        "span": metrics.span(learned.posture_map, true),
        "disparity": fit.disparity,
        "scale": fit.scale,
        "quantization_error": metrics.quantization_error(units, samples),
        "topographic_error": metrics.topographic_error(units, samples),
    }
