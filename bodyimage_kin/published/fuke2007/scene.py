"""What all estimators of one motion and seed share: recordings, probes and the truth to be scored against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.spatial
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import BodyImage, PostureSOM
from bodyimage_kin.published.fuke2007.conditions import Motion, Settings
from bodyimage_kin.recordings import experience, first_taxel, motions, simulate, write_recording
from bodyimage_kin.study.maps import POSTURE_GRID, seen_range

_IN_FRONT = 0.03


@dataclass(frozen=True, eq=False)
class Lesson:
    """What maps are learned from, whoever says where the hand is.

    Attributes:
        felt: Experience of the touches, one trial.
        grid: (rows, columns) of taxels.
        image_range: (m, 2) lowest and highest image of the hand that was ever seen: bounds of the first weights.
        posture_som: Representative postures, trained once.
    """

    felt: xr.Dataset
    grid: tuple[int, int]
    image_range: Float[np.ndarray, "m 2"]
    posture_som: PostureSOM

    def learn(self, hand: xr.DataArray, seed: int, snapshots: Sequence[int] = (), **settings: Any) -> BodyImage:
        """The maps that these hand images lead to."""
        given = {"image_range": self.image_range, "posture_som": self.posture_som, **settings}
        return BodyImage.learn(self.felt, hand, grid=self.grid, seed=seed, snapshots=snapshots, **given)


@dataclass(frozen=True, eq=False)
class Scene:
    """What all estimators of one motion and seed are scored against.

    Attributes:
        body: The embodiment.
        seed: The seed.
        circle: Recording in view.
        tour: Recording of the tour.
        touch: Recording of the touches.
        probes: Probe -> postures.
        truth: Probe -> true Jacobians.
        excitation: Of touching by the circle.
        true_map: Where a perfect map has each taxel [m].
        loop: Postures over the landmarks and back to the first.
        lesson: What maps are learned from.
    """

    body: Embodiment
    seed: int
    circle: xr.Dataset
    tour: xr.Dataset
    touch: xr.Dataset
    probes: Mapping[str, torch.Tensor]
    truth: Mapping[str, np.ndarray]
    excitation: metrics.Excitation
    true_map: Float[np.ndarray, "rows columns m"]
    loop: Float[torch.Tensor, "time p"]
    lesson: Lesson


def make_scene(settings: Settings, body: Embodiment, motion: Motion, seed: int, folder: Path) -> Scene:
    """Simulates, and writes the recordings into the folder, ``MOTION_seedSEED_KIND.nc``."""
    noise = replace(motion.noise, encoder=settings.encoder_noise, image=settings.image_noise)
    asked: dict[str, Any] = {"seed": seed, "dynamics": motion.dynamics, "noise": noise}
    circle = simulate(body, motions.Circle(), **asked)
    tour = simulate(body, motions.FaceTour(), **asked)
    touch = simulate(body, motions.RandomTouch(settings.touch_duration), **asked)
    for kind, recording in {"circle": circle, "face_tour": tour, "random_touch": touch}.items():
        write_recording(recording, folder / f"{motion.name}_seed{seed}_{kind}.nc")
    probes = probe_postures(body, circle)
    touching = touch["true_q"].values[0][first_taxel(touch, truth=True)[0] >= 0]
    return Scene(
        body=body,
        seed=seed,
        circle=circle,
        tour=tour,
        touch=touch,
        probes=probes,
        truth={probe: body.hand_image_jacobian(q).numpy() for probe, q in probes.items()},
        excitation=metrics.excitation(circle, touch),
        true_map=body.hand_image(probes["on_face"]).numpy().reshape(*body.require_skin().shape, body.m),
        loop=_closed_loop(body),
        lesson=Lesson(
            experience(touch),
            body.require_skin().shape,
            seen_range(circle),
            PostureSOM.fit(touching, POSTURE_GRID, seed),
        ),
    )


def probe_postures(body: Embodiment, circle: xr.Dataset) -> dict[str, Float[torch.Tensor, "postures p"]]:
    """The posture sets at which Jacobians are scored, :data:`PROBES`."""
    seen = circle["true_q"].values.reshape(-1, body.p)
    everywhere = np.arange(body.require_skin().count)
    return {
        "on_circle": torch.from_numpy(seen[np.isfinite(seen).all(1)]),
        "in_front": body.touch_postures(everywhere, _IN_FRONT),
        "on_face": body.touch_postures(everywhere),
    }


def depth_scale(scene: Scene) -> float:
    """How much farther the hand was on the circle than it is while touching: what a scaled rival is told."""
    with torch.no_grad():
        depth = scene.body.hand_in_camera(scene.probes["on_circle"])[:, 2]
    return float(depth.mean()) / scene.body.camera.screen.distance


def distances(scene: Scene) -> dict[str, np.ndarray]:
    """How far the hand is from where it was ever seen [m]."""
    tree = scipy.spatial.KDTree(scene.circle["true_hand_position"].values.reshape(-1, 3))
    with torch.no_grad():
        return {
            probe: np.asarray(tree.query(scene.body.hand_position(q).numpy())[0]) for probe, q in scene.probes.items()
        }


def jacobian_change(scene: Scene) -> float:
    """How much the mean true Jacobian changes from the circle to the face, in the metric of touching."""
    seen, touching = scene.truth["on_circle"].mean(0), scene.truth["on_face"].mean(0)
    return metrics.pooled_relative_error(touching[None], seen[None], scene.excitation.motion_metric)


def _closed_loop(body: Embodiment) -> Float[torch.Tensor, "time p"]:
    """Postures over the landmarks of the face and back to the first: each place has one posture, so the loop closes."""
    tour = motions.FaceTour(landmarks=(*motions.TOUR, motions.TOUR[0]))
    path = tour.path(body, np.random.default_rng(0), tour.sampling)
    postures, _ = body.reach(torch.from_numpy(path.centres))
    return torch.cat([postures, postures[:1]])
