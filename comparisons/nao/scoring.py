"""A map of a real skin and its scores, and what twenty circles and their draws of touches say together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import xarray as xr
from fitting import Found

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.body_image import PostureSOM

STEPS = 8000
NOISE = bk.Noise(encoder=1e-3, image=2e-4)
SIGHT, CHANCE = "direct sight", "chance"
COLUMNS = {
    "jacobian": ("relative Jacobian error", 1.0, 3),
    "hand": ("hand, median [mm]", 1e3, 1),
    "disparity": ("disparity", 1.0, 3),
    "neighbours_kept": ("neighbours kept", 1.0, 2),
    "trustworthiness": ("trustworthiness", 1.0, 3),
    "map": ("map error [mm]", 1e3, 1),
    "relations": ("relations kept", 1.0, 3),
}
"""Score -> what it is called, its factor, and decimals."""
Scores = dict[str, list[dict[str, float]]]
"""Estimator -> its scores, a table a draw of blocks."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What every circle has in common.

    Attributes:
        body: The calibrated body.
        drawn: As it is drawn, seen by the same eye.
        touches: Those that are mapped.
        drawn_offset: Where each touched, on the drawn hand [m]; None: always at its centre.
        resamples: Draws of their blocks, beside all of them as they are.
        winners: Of taxels felt at once, as :meth:`bodyimage_kin.BodyImage.learn` has it: what covers many of them is
            in their middle.
    """

    body: bk.Embodiment
    drawn: bk.Embodiment
    touches: xr.Dataset
    drawn_offset: np.ndarray | None
    resamples: int = 4
    winners: str = "largest"

    @classmethod
    def of(cls, found: Found) -> Setting:
        """All touches of what was found."""
        rule = "largest" if found.what.by == "finger" else "middle"
        return cls(found.body, found.drawn, found.touches, found.drawn_offset, winners=rule)

    @property
    def q(self) -> np.ndarray:
        """(touches, p) postures [rad]."""
        return np.asarray(self.touches["q"].values[0])

    @property
    def offset(self) -> np.ndarray | None:
        """(touches, 3) where each touched, on the calibrated hand [m]."""
        return self.touches["hand_offset"].values[0] if "hand_offset" in self.touches else None

    def rows(self, seed: int, draw: int) -> np.ndarray:
        """Samples of a draw of blocks, the same for every estimator; draw 0: all as they are."""
        block = self.touches["block"].values[0]
        if draw == 0:
            return np.arange(len(block))
        names = np.unique(block)
        drawn = np.random.default_rng([seed, draw]).choice(names, len(names))
        return np.concatenate([np.flatnonzero(block == one) for one in drawn])

    def referred(self) -> xr.Dataset:
        """The touches, the one nearest to the middle taxel being the place from which all others are reached."""
        skin = self.body.require_skin()
        there = np.zeros((1, len(self.q)), dtype=bool)
        at = self.body.hand_in_skin(self.q, self.offset).numpy() - skin.link_positions[skin.reference]
        first = int(np.linalg.norm(at, axis=1).argmin())
        there[0, first] = True
        sight = self.body.hand_image(self.q, self.offset).numpy()
        referred = self.touches.assign(at_reference=(("trial", "time"), there), reference_image=("axis", sight[first]))
        return referred.assign_coords(axis=list(self.body.camera.model.names))

    def true_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Published places of the taxels: in the camera's axes (taxels, 3) [m], and their images (taxels, 2) [m]."""
        pose = self.body.camera.link_T_camera.numpy()
        points = (self.body.require_skin().link_positions - pose[:3, 3]) @ pose[:3, :3]
        return points, self.body.camera.model.project(torch.from_numpy(points)).numpy()

    def scores(self, images: Mapping[str, np.ndarray], told: Mapping[str, dict[str, float]], seed: int) -> Scores:
        """Of the maps that hand images (touches, 2) [m] lead to, beside what was told of each before."""
        som = PostureSOM.fit(self.q, (8, 8), seed)
        return {
            name: [
                told.get(name, {}) | self._scored(image, som, seed, draw, name == CHANCE)
                for draw in range(self.resamples + 1)
            ]
            for name, image in images.items()
        }

    def _scored(self, image: np.ndarray, som: PostureSOM, seed: int, draw: int, dealt: bool) -> dict[str, float]:
        """Scores of one map, on the taxels that were touched."""
        rows, skin = self.rows(seed, draw), self.body.require_skin()
        touches = self.touches.isel(time=rows)
        if dealt:
            shuffled = metrics.shuffled_touches(touches["touched"].values, seed)
            touches = touches.assign(touched=(touches["touched"].dims, shuffled))
        learned = bk.BodyImage.learn(
            touches,
            image[rows][None],
            skin=skin,
            steps=STEPS,
            seed=seed,
            posture_som=som,
            snapshots=(),
            winners=self.winners,
        )
        points, true = self.true_places()
        touched = learned.touch_counts > 0
        scores = metrics.scores(learned.tactile_map, true, touched)
        away = metrics.error_in_space(learned.tactile_map[touched], points[touched], self.body.camera.model)
        kept = {score: float(scores[score]) for score in ("disparity", "neighbours_kept", "trustworthiness", "scale")}
        return kept | {
            "map": float(np.median(away)),
            "relations": _relations(learned.tactile_map, true, touched, skin.units),
            "taxels": float(touched.sum()),
        }


def _relations(map: np.ndarray, true: np.ndarray, touched: np.ndarray, units: np.ndarray) -> float:
    """Share of pairs of triangles that lie left of and above one another in the map as they do in truth.

    Only pairs that are a triangle apart along an axis count.
    """
    names = np.unique(units[touched])
    middles = [np.stack([one[touched & (units == unit)].mean(0) for unit in names]) for one in (map, true)]
    apart = [one[:, None] - one for one in middles]
    wide = np.median(np.sort(np.linalg.norm(apart[1], axis=-1), axis=1)[:, 1])
    meant = np.abs(apart[1]) > wide
    return float((np.sign(apart[0]) == np.sign(apart[1]))[meant].mean())


def summary(circles: list[Scores]) -> dict[str, dict[str, list[float]]]:
    """Estimator -> score -> mean over circles, and the 2.5 and 97.5 % quantiles over circles and draws of blocks."""
    found: dict[str, dict[str, list[float]]] = {}
    for name in circles[0]:
        found[name] = {}
        for score in COLUMNS:
            if score in circles[0][name][0]:
                whole = [one[name][0][score] for one in circles]
                drawn = [draw[score] for one in circles for draw in one[name][1:]]
                if np.isnan([*whole, *drawn]).any():
                    # Too few taxels in a draw to speak of their neighbourhoods.
                    continue
                found[name][score] = [float(np.mean(whole)), *map(float, np.quantile(drawn, [0.025, 0.975]))]
    return found


def nearer(circles: list[Scores], than: str = "least squares") -> dict[str, float]:
    """How often, over circles and draws, an estimator's map is nearer to the truth than another's."""
    names = [name for name in circles[0] if name not in (SIGHT, CHANCE, than)]
    return {
        name: float(
            np.mean([a["map"] < b["map"] for one in circles for a, b in zip(one[name], one[than], strict=True)])
        )
        for name in names
    }


def table_of_scores(scores: Mapping[str, Mapping[str, list[float]]]) -> str:
    """A row an estimator, a column a score that any of them has."""
    shown = {score: how for score, how in COLUMNS.items() if any(score in one for one in scores.values())}
    lines = [["", *(title for title, _, _ in shown.values())], ["---"] + ["---:"] * len(shown)]
    for name, one in scores.items():
        cells = [name]
        for score, (_, factor, digits) in shown.items():
            if score not in one:
                cells.append("")
                continue
            mean, low, high = (f"{factor * value:.{digits}f}" for value in one[score])
            cells.append(mean if low == high == mean else f"{mean} [{low}, {high}]")
        lines.append(cells)
    return rows_of(lines)


def table_of_fits(calibration: Mapping[str, Mapping[str, Any]]) -> str:
    """A row a fit."""
    lines = [["calibrated", "numbers", "held-out touch, median [mm]"], ["---", "---:", "---:"]]
    lines += [[name, str(one["numbers"]), f"{one['held_out_mm']:.2f}"] for name, one in calibration.items()]
    return rows_of(lines)


def rows_of(lines: list[list[str]]) -> str:
    """A table of Markdown."""
    return "".join(f"| {' | '.join(row)} |\n" for row in lines)
