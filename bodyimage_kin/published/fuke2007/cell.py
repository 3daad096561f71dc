"""One motion and seed, from the recordings to the maps: a cell of the study.

In each cell a Jacobian is learned from the circle in view, tried on the tour of the face, and integrated to learn the
body image while the face is touched at random; the analytic Jacobian and direct sight of the unseen hand go through the
same steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin.body.file import load_embodiment
from bodyimage_kin.body_image import integrate
from bodyimage_kin.estimators import Analytic, Estimator, LeastSquares
from bodyimage_kin.published.fuke2007.blindness import Blindness, measure_blindness
from bodyimage_kin.published.fuke2007.conditions import CONDITIONS, DIRECT, Condition, Motion, Settings
from bodyimage_kin.published.fuke2007.scene import Scene, depth_scale, distances, jacobian_change, make_scene
from bodyimage_kin.published.fuke2007.scores import Mapped, Scored, learn_map, score
from bodyimage_kin.recordings import experience

_OTHER_FIRST_MAPS = 9
"""Further first maps over the first seed's recording: with its own, the ten of the paper's Fig. 11."""
BLINDNESS = "noise_free_200"
"""The condition whose recordings show what each measure sees of a corrupted Jacobian."""


@dataclass(frozen=True, eq=False)
class Cell:
    """Everything that came of one condition and seed.

    Attributes:
        condition: Name of the condition.
        seed: The seed.
        scored: Estimator -> scores.
        mapped: Estimator, or :data:`DIRECT` -> maps.
        tour_time: (time,) [s].
        tour_image: (time, m) true hand image on the tour [m].
        circle_position: (time, 3) true hand position on the circle, in the root [m].
        circle_q: (time, p) true postures on the circle [rad].
        distance: Probe -> (postures,) distance of the hand from the nearest seen place [m].
        excitation: (p,) how much the circle excites what touching uses, most first.
        jacobian_change: Relative change of the mean true Jacobian from the circle to the face, in the motion's metric.
        postures: (8, 8, p) representative postures of the posture map [rad].
        other_maps: (maps, snapshots) topological errors from other first maps; of the first seed only.
        blindness: What each measure makes of corrupted true Jacobians; of one condition only.
    """

    condition: str
    seed: int
    scored: Mapping[str, Scored]
    mapped: Mapping[str, Mapped]
    tour_time: Float[np.ndarray, "time"]
    tour_image: Float[np.ndarray, "time m"]
    circle_position: Float[np.ndarray, "circle 3"]
    circle_q: Float[np.ndarray, "circle p"]
    distance: Mapping[str, np.ndarray]
    excitation: Float[np.ndarray, "p"]
    jacobian_change: float
    postures: Float[np.ndarray, "rows columns p"]
    other_maps: Float[np.ndarray, "maps snapshots"]
    blindness: Blindness | None


def run_cell(settings: Settings, motion: Motion, seed: int, folder: Path) -> list[Cell]:
    """One motion and seed, under every condition that moves so; the recordings are written into the folder.

    Args:
        settings: Of the run.
        motion: How the arm moves.
        seed: Of recordings, first weights and first maps.
        folder: Where the recordings go, ``MOTION_seedSEED_KIND.nc``.
    """
    torch.set_num_threads(1)
    body = load_embodiment(settings.embodiment, settings.backend)
    scene = make_scene(settings, body, motion, seed, folder)
    shared = {
        "least_squares": LeastSquares(),
        "least_squares_scaled": LeastSquares(scale=depth_scale(scene)),
        "analytic": Analytic(body),
    }
    once = {name: _pursue(scene, spec) for name, spec in shared.items()}
    midpoint = _pursue(scene, shared["analytic"], method="midpoint")
    direct = learn_map(scene, scene.touch["true_hand_image"])
    cells = []
    for condition in CONDITIONS:
        if condition.motion == motion:
            paper = _pursue(scene, condition.network)
            pursued = {"paper_mlp": paper, **once, "analytic_midpoint": midpoint}
            cells.append(_cell(scene, condition, pursued, direct))
    return cells


@dataclass(frozen=True, eq=False)
class _Pursued:
    """One estimator, all the way."""

    scored: Scored
    hand: xr.DataArray
    mapped: Mapped


def _pursue(scene: Scene, spec: Estimator, method: str = "euler") -> _Pursued:
    """Learns, scores and maps with one estimator."""
    learned = spec.fit(experience(scene.circle), seed=scene.seed)
    hand = integrate(experience(scene.touch), learned, method=method)
    return _Pursued(score(scene, learned, method), hand, learn_map(scene, hand))


def _cell(scene: Scene, condition: Condition, pursued: Mapping[str, _Pursued], direct: Mapped) -> Cell:
    mapped = {name: one.mapped for name, one in pursued.items()}
    other = [
        learn_map(scene, pursued["paper_mlp"].hand, seed=1000 + index).topological_errors
        for index in range(_OTHER_FIRST_MAPS)
        if scene.seed == 0 and condition.paper
    ]
    return Cell(
        condition=condition.name,
        seed=scene.seed,
        scored={name: one.scored for name, one in pursued.items()},
        mapped={**mapped, DIRECT: direct},
        tour_time=scene.tour["time"].values,
        tour_image=scene.tour["true_hand_image"].values[0],
        circle_position=scene.circle["true_hand_position"].values[0],
        circle_q=scene.circle["true_q"].values[0],
        distance=distances(scene),
        excitation=scene.excitation.eigenvalues,
        jacobian_change=jacobian_change(scene),
        postures=scene.lesson.posture_som.postures,
        other_maps=np.array(other, dtype=float).reshape(len(other), len(direct.steps)),
        blindness=measure_blindness(scene) if condition.name == BLINDNESS else None,
    )
