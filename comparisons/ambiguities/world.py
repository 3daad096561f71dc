"""Recordings of one motion and seed, and the scores of what is learned from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
import xarray as xr
from networks import Network, Perceptron

import bodyimage_kin as bk
from bodyimage_kin.body_image import PostureSOM
from bodyimage_kin.estimators import LearnedJacobian
from bodyimage_kin.recordings import first_taxel

Scores = Mapping[str, float]


@dataclass(frozen=True, eq=False)
class World:
    """Recordings of one motion and seed, and the truth they are scored against."""

    body: bk.Embodiment
    seed: int
    steps: int
    circle: xr.Dataset
    tour: xr.Dataset
    touch: xr.Dataset

    @classmethod
    def record(cls, body: bk.Embodiment, seed: int, steps: int, duration: float, **settings: Any) -> World:
        """Simulates; `settings` (dynamics, noise) go to each of the three motions."""
        return cls(
            body,
            seed,
            steps,
            bk.simulate(body, bk.motions.Circle(), seed, **settings),
            bk.simulate(body, bk.motions.FaceTour(), seed, **settings),
            bk.simulate(body, bk.motions.RandomTouch(duration), seed, **settings),
        )

    @cached_property
    def learned(self) -> Perceptron:
        """The paper's network, learned from the circle."""
        return Network(steps=self.steps).fit(bk.experience(self.circle), self.seed)

    @cached_property
    def hand(self) -> xr.DataArray:
        """The hand image it estimates while touching."""
        return bk.integrate(bk.experience(self.touch), self.learned)

    @cached_property
    def postures(self) -> torch.Tensor:
        """Touching each taxel."""
        return self.body.touch_postures(np.arange(self.body.skin.count))

    @cached_property
    def truth(self) -> np.ndarray:
        """True Jacobians at these postures."""
        return self.body.hand_image_jacobian(self.postures).numpy()

    @cached_property
    def true_map(self) -> np.ndarray:
        """Where a perfect map has each taxel [m]."""
        return self.body.hand_image(self.postures).numpy().reshape(*self.body.skin.shape, self.body.m)

    @cached_property
    def motion(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Postures and displacements of the true touching motion."""
        q = torch.from_numpy(self.touch["true_q"].values[0])
        return q[:-1], q[1:] - q[:-1]

    @cached_property
    def moved(self) -> np.ndarray:
        """J dq of that motion."""
        q, dq = self.motion
        return (self.body.hand_image_jacobian(q) @ dq[..., None])[..., 0].numpy()

    @cached_property
    def posture_som(self) -> PostureSOM:
        """The posture map's representative postures."""
        touching = self.touch["true_q"].values[0][first_taxel(self.touch, truth=True)[0] >= 0]
        return PostureSOM.fit(touching, (8, 8), self.seed)


def of_jacobian(world: World, learned: LearnedJacobian) -> dict[str, float]:
    """Displacement error on the touching motion, pooled Jacobian error on the face, RMSE on the tour."""
    q, dq = world.motion
    image = world.tour["true_hand_image"].values[0]
    path = bk.integrate(bk.experience(world.tour), learned, reset="none", initial=image[0]).values[0]
    use = bk.metrics.motion_metric(dq, "true")
    with torch.no_grad():
        estimated = learned.jacobian(world.postures).numpy()
        foreseen = learned.displacement(q, dq).numpy()
    return {
        "displacement": bk.metrics.displacement_error(foreseen, world.moved),
        "face": bk.metrics.pooled_relative_error(world.truth, estimated, use),
        "tour": _rmse(image, path),
    }


def of_map(world: World, hand: xr.DataArray, **settings: Any) -> dict[str, float]:
    """RMSE of the hand estimate while touching, and scores of the map learned from it."""
    true = world.touch["true_hand_image"].values[0]
    settings = {"seed": world.seed, "image_range": _seen_range(world), "posture_som": world.posture_som, **settings}
    if not np.isfinite(hand.values).all():
        # A network that diverged: its map is that of the few samples before.
        return dict.fromkeys(("touch", "span", "disparity", "topological", "posture_span"), np.nan)
    maps = bk.BodyImage.learn(bk.experience(world.touch), hand, **settings)
    scores = bk.metrics.scores(maps.tactile_map, world.true_map)
    postures = world.body.hand_image(torch.from_numpy(maps.postures), on_invisible="nan").numpy()
    return {
        "touch": _rmse(true, hand.values[0]),
        "span": float(np.mean(scores["span"])),
        "disparity": float(scores["disparity"]),
        "topological": float(scores["topological_error"]),
        "posture_span": float(np.mean(bk.metrics.span(maps.posture_map, postures))),
    }


def of_all(world: World, learned: LearnedJacobian) -> dict[str, float]:
    """Everything, for a Jacobian that is used as the library uses it."""
    return of_jacobian(world, learned) | of_map(world, bk.integrate(bk.experience(world.touch), learned))


def of_world(world: World) -> dict[str, float]:
    """Everything, for recordings that the library's network learns from."""
    singular = np.linalg.svd(np.diff(world.circle["q"].values[0], axis=0), compute_uv=False)
    return of_jacobian(world, world.learned) | of_map(world, world.hand) | {"excitation": singular[-1] / singular[0]}


def _rmse(true: np.ndarray, estimated: np.ndarray) -> float:
    """In millimetres; NaN where an estimate is, which the metric would leave out."""
    return 1e3 * bk.metrics.trajectory_rmse(true, estimated) if np.isfinite(estimated).all() else np.nan


def _seen_range(world: World) -> np.ndarray:
    seen = world.circle["hand_image"].values.reshape(-1, world.body.m)
    return np.stack([np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)], axis=1)
