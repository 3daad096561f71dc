"""The end of the chain in a study: what a Jacobian's error does to the touched path, and that to the maps.

All estimators of one recording learn their maps from the same touches, with the same first weights and the same posture
map, and so does *direct sight*, which is handed the true image of the hand. The kernel that neighbours learn by shrinks
every map, the one of direct sight as well: held against that one, the kernel's own share is out of a map's error, and
what is left comes from the estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import BodyImage, PostureSOM
from bodyimage_kin.errors import InvalidRecording
from bodyimage_kin.recordings import experience, first_taxel

POSTURE_GRID = (8, 8)
"""Of the posture map."""


@dataclass(frozen=True, eq=False)
class Lesson:
    """What maps are learned from, whoever says where the hand is.

    Attributes:
        felt: Experience of the touches, one trial.
        grid: (rows, columns) of taxels.
        image_range: (m, 2) lowest and highest image of the hand that was ever seen [m]: bounds of the first weights.
        posture_som: Representative postures, trained once.
    """

    felt: xr.Dataset
    grid: tuple[int, int]
    image_range: Float[np.ndarray, "m 2"]
    posture_som: PostureSOM

    def learn(self, hand: xr.DataArray, seed: int, snapshots: Sequence[int] = (), **settings: Any) -> BodyImage:
        """The maps that these hand images lead to.

        Args:
            hand: (trial, time, m) hand images [m].
            seed: Of the first maps.
            snapshots: Steps at which maps are kept; the last one always is.
            settings: Of :meth:`bodyimage_kin.BodyImage.learn`.
        """
        return BodyImage.learn(
            self.felt,
            hand,
            grid=self.grid,
            seed=seed,
            snapshots=snapshots,
            image_range=self.image_range,
            posture_som=self.posture_som,
            **settings,
        )


def lesson(body: Embodiment, training: xr.Dataset, touch: xr.Dataset, seed: int) -> Lesson:
    """What maps are learned from, of felt things alone.

    Args:
        body: The embodiment.
        training: The recording in view.
        touch: The recording of the touches.
        seed: Of the posture map.

    Raises:
        InvalidRecording: No touches.
    """
    felt = experience(touch)
    q, taxel = felt["q"].values[0], first_taxel(felt)[0]
    if not (taxel >= 0).any():
        raise InvalidRecording("the hand never felt a touch, so there is nothing to map; let touch.duration be longer")
    som = PostureSOM.fit(q[taxel >= 0], POSTURE_GRID, seed)
    return Lesson(felt, body.require_skin().shape, seen_range(training), som)


def seen_range(training: xr.Dataset) -> Float[np.ndarray, "m 2"]:
    """Lowest and highest felt image of the hand along each axis [m]."""
    seen = training["hand_image"].values.reshape(-1, training.sizes["axis"])
    return np.stack([np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)], axis=1)


# The same for every recording and estimator of an embodiment, so a worker finds it once.
@lru_cache(maxsize=8)
def true_map(body: Embodiment) -> Float[np.ndarray, "rows columns m"]:
    """Where the hand's image is while it touches each taxel [m]: what a perfect map holds."""
    with torch.no_grad():
        image = body.hand_image(body.touch_postures(np.arange(body.require_skin().count)))
    return image.numpy().reshape(*body.require_skin().shape, body.m)


def direct_facts(body: Embodiment, training: xr.Dataset, touch: xr.Dataset, seeds: Sequence[int]) -> xr.Dataset:
    """The maps of direct sight, and what the kernel alone does to them.

    Args:
        body: The embodiment.
        training: The recording in view.
        touch: The recording of the touches.
        seeds: Of the posture map, then of each of the first maps.

    Returns:
        ``posture_units`` and ``posture_scale`` of the posture map; ``direct_map`` and ``direct_posture_map`` over
        ``first_map``; scores of ``direct_map`` against the true taxels, means over first maps.
    """
    ground = lesson(body, training, touch, seeds[0])
    learned = [ground.learn(touch["true_hand_image"], seed) for seed in seeds[1:]]
    truth = true_map(body)
    of = {name: np.mean([score(one, truth)[name] for one in learned], axis=0) for name in _KERNEL}
    maps = np.stack([one.tactile_map for one in learned])
    posture_maps = np.stack([one.posture_map for one in learned])
    units, metres = ("unit_row", "unit_column"), {"units": "m"}
    return xr.Dataset(
        {
            "posture_units": ((*units, "joint"), ground.posture_som.postures, {"units": "rad"}),
            "posture_scale": (("joint",), ground.posture_som.scale, {"units": "rad"}),
            "direct_map": (("first_map", "row", "column", "axis"), maps, metres),
            "direct_posture_map": (("first_map", *units, "axis"), posture_maps, metres),
            "direct_map_error_to_truth": (
                (),
                of["map_error_to_truth"],
                {"long_name": "distance of the map of direct sight from the true taxels: the kernel's share", **metres},
            ),
            "direct_map_span": (
                ("axis",),
                of["map_span"],
                {"long_name": "extent of the map of direct sight over the true one", "units": "1"},
            ),
            "direct_map_topological_error": (
                (),
                of["map_topological_error"],
                {"long_name": "taxels of the map of direct sight out of order with a neighbour", "units": "1"},
            ),
        },
        {"axis": touch["axis"].values},
    )


def scores(
    body: Embodiment,
    training: xr.Dataset,
    touch: xr.Dataset,
    hand: xr.DataArray,
    facts: xr.Dataset,
    seeds: Sequence[int],
) -> dict[str, Any]:
    """Scores of the maps that an estimate leads to, means over the first maps.

    Args:
        body: The embodiment.
        training: The recording in view.
        touch: The recording of the touches.
        hand: (trial, time, m) estimated hand image on it [m].
        facts: Of :func:`direct_facts`, one recording's.
        seeds: One for each of the first maps, those of the facts.
    """
    som = PostureSOM(facts["posture_units"].values, facts["posture_scale"].values)
    ground = Lesson(experience(touch), body.require_skin().shape, seen_range(training), som)
    truth, found = true_map(body), []
    for index, seed in enumerate(seeds):
        learned = ground.learn(hand, seed)
        direct = facts.isel(first_map=index)
        found.append(
            score(learned, truth)
            | {
                "map_error": relative_distance(learned.tactile_map, direct["direct_map"].values),
                "posture_map_error": relative_distance(learned.posture_map, direct["direct_posture_map"].values),
            }
        )
    return {name: np.mean([one[name] for one in found], axis=0) for name in found[0]}


_KERNEL = ("map_error_to_truth", "map_span", "map_topological_error")
"""Scores that say what direct sight itself does to a map."""


def score(learned: BodyImage, truth: Float[np.ndarray, "rows columns m"]) -> dict[str, Any]:
    """Scores of one map against the true taxels [m]."""
    of = metrics.scores(learned.tactile_map, truth)
    return {
        "map_error_to_truth": metrics.trajectory_rmse(truth, learned.tactile_map),
        "map_topological_error": of["topological_error"],
        "map_span": of["span"],
        "map_disparity": of["disparity"],
        "map_folded_cells": of["folded_cells"],
    }


def relative_distance(
    map: Float[np.ndarray, "rows columns m"], reference: Float[np.ndarray, "rows columns m"]
) -> float:
    """RMS distance of a map from another, over the RMS extent of that other about its middle."""
    centre = np.broadcast_to(reference.mean((0, 1)), reference.shape)
    return metrics.trajectory_rmse(reference, map) / metrics.trajectory_rmse(reference, centre)
