"""How blind is each measure? The true Jacobian, corrupted by known doses, goes through the whole pipeline.

What a measure makes of the uncorrupted truth over recordings says where it raises a false alarm; the share of
recordings in which it goes beyond that is its power to see the corruption.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin import metrics
from bodyimage_kin.body_image import integrate
from bodyimage_kin.estimators import Analytic, LearnedJacobian
from bodyimage_kin.published.fuke2007.scene import Scene
from bodyimage_kin.published.fuke2007.scores import Mapped, Scored, learn_map, score
from bodyimage_kin.recordings import experience

FALSE_ALARMS = 0.05
"""Share of uncorrupted recordings that a measure may take for corrupted."""
DOSES: Mapping[str, tuple[float, ...]] = {
    "scale": (0.9, 0.75, 0.5, 0.25),
    "rotation": (5.0, 15.0, 30.0, 60.0),
    "rank": (0.25, 0.5, 0.75, 1.0),
    "noise": (0.1, 0.3, 0.6, 1.0),
}
"""Factor of all entries; turn in the image [degrees]; share of the smaller singular value that is taken away; norm of a
constant random matrix over that of the Jacobian."""
MEASURES = (
    "jacobian_error_use",
    "velocity_correlation",
    "velocity_nrmse",
    "trajectory_rmse",
    "topological_error",
    "map_span",
    "folded_cells",
    "map_disparity",
    "map_scale",
)
"""Each in a form in which more is worse: 1 - correlation; spans and scales by their distance from direct sight's."""


@dataclass(frozen=True, eq=False)
class Blindness:
    """What every measure makes of every dose in one recording, more being worse.

    Attributes:
        truth: Measure -> of the uncorrupted Jacobian.
        corrupted: Corruption -> measure -> one value a dose.
        permuted: Topological error of the true Jacobian's map with its taxels' labels permuted.
    """

    truth: Mapping[str, float]
    corrupted: Mapping[str, Mapping[str, Float[np.ndarray, "doses"]]]
    permuted: int


@dataclass(frozen=True, eq=False)
class Corrupted(LearnedJacobian):
    """The true Jacobian, corrupted at every posture alike.

    Attributes:
        true: The analytic one.
        corrupt: (*batch, m, p) -> (*batch, m, p).
    """

    true: LearnedJacobian
    corrupt: Callable[[Tensor], Tensor]

    @property
    def p(self) -> int:
        """Number of felt joints."""
        return self.true.p

    @property
    def m(self) -> int:
        """Number of coordinates of a hand image."""
        return self.true.m

    def _displacement(self, q: Float[Tensor, "*batch p"], dq: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m"]:
        return (self._jacobian(q) @ dq[..., None])[..., 0]

    def _jacobian(self, q: Float[Tensor, "*batch p"]) -> Float[Tensor, "*batch m p"]:
        return self.corrupt(self.true.jacobian(q))


def corruption(kind: str, dose: float, seed: int) -> Callable[[Tensor], Tensor]:
    """How a dose of one kind of :data:`DOSES` changes Jacobians; the seed draws the noise."""
    if kind == "scale":
        return lambda J: dose * J
    if kind == "rotation":
        angle = np.radians(dose)
        c, s = np.cos(angle), np.sin(angle)
        return lambda J: torch.tensor([[c, -s], [s, c]], dtype=J.dtype) @ J
    if kind == "rank":

        def without_least(J: Tensor) -> Tensor:
            U, S, Vt = torch.linalg.svd(J, full_matrices=False)
            kept = torch.ones_like(S)
            kept[..., -1] = 1.0 - dose
            return (U * (S * kept)[..., None, :]) @ Vt

        return without_least
    noise = torch.from_numpy(np.random.default_rng(seed).standard_normal((64, 64)))

    def added(J: Tensor) -> Tensor:
        matrix = noise[: J.shape[-2], : J.shape[-1]].to(J)
        size = torch.linalg.matrix_norm(J).mean() / torch.linalg.matrix_norm(matrix)
        return J + dose * size * matrix

    return added


def measure_blindness(scene: Scene) -> Blindness:
    """What every measure makes of the corrupted truth in one recording."""
    direct = learn_map(scene, scene.touch["true_hand_image"], snapshots=(1.0,))
    true = Analytic(scene.body).fit(experience(scene.circle))
    truth, map = _measures(scene, true, direct)
    corrupted: dict[str, dict[str, np.ndarray]] = {}
    for kind, doses in DOSES.items():
        found = [_measures(scene, Corrupted(true, corruption(kind, dose, scene.seed)), direct)[0] for dose in doses]
        corrupted[kind] = {measure: np.array([one[measure] for one in found]) for measure in MEASURES}
    permuted = metrics.topological_error(metrics.permuted(map.maps[-1], seed=scene.seed))
    return Blindness(truth, corrupted, permuted)


def power(found: Sequence[Blindness]) -> dict[str, dict[str, list[float]]]:
    """Corruption -> measure -> share of recordings in which each dose is seen.

    A dose is seen where the measure goes beyond the quantile of the uncorrupted recordings that leaves
    :data:`FALSE_ALARMS` of them above it.
    """
    seen: dict[str, dict[str, list[float]]] = {}
    for kind in DOSES:
        seen[kind] = {}
        for measure in MEASURES:
            truth = np.array([one.truth[measure] for one in found])
            limit = np.quantile(truth, 1.0 - FALSE_ALARMS, method="higher")
            values = np.array([one.corrupted[kind][measure] for one in found])
            # Rounding differs between a rotation by nothing and nothing: what is equal but for that is not beyond.
            beyond = values > limit + 1e-9 * max(1.0, abs(float(limit)))
            seen[kind][measure] = beyond.mean(axis=0).tolist()
    return seen


def _measures(scene: Scene, learned: LearnedJacobian, direct: Mapped) -> tuple[dict[str, float], Mapped]:
    scored = score(scene, learned)
    felt = experience(scene.touch)
    mapped = learn_map(scene, integrate(felt, learned), snapshots=(1.0,))
    return _worse(scored, mapped, direct), mapped


def _worse(scored: Scored, mapped: Mapped, direct: Mapped) -> dict[str, float]:
    final: Mapping[str, Any] = mapped.final
    return {
        "jacobian_error_use": scored.jacobian_relative_error_use["on_face"],
        "velocity_correlation": 1.0 - float(np.min(scored.velocity_correlation)),
        "velocity_nrmse": float(np.max(scored.velocity_nrmse)),
        "trajectory_rmse": scored.trajectory_rmse,
        "topological_error": float(final["topological_error"]),
        "map_span": float(np.max(np.abs(np.log(np.maximum(final["span"], 1e-9) / direct.final["span"])))),
        "folded_cells": float(final["folded_cells"]),
        "map_disparity": float(final["disparity"]),
        "map_scale": float(abs(np.log(max(final["scale"], 1e-9) / direct.final["scale"]))),
    }
