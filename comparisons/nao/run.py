"""A real NAO touches itself: ``python comparisons/nao/run.py --data FOLDER``, tables and a figure beside this file.

FOLDER has ``nao/`` with ``torso_rightFinger.mat``, ``head_leftFinger.mat`` and the folder ``Transformations``, all of
the robot ``nao`` in ``ctu-vras/multirobot-calibration`` (``UserData/Robots``) on GitHub. Some three minutes a part on
two quiet cores; ``--quick`` for a first look at two circles.

The touches are cut into 20 contiguous blocks. On every second one the body is calibrated; on the others, held out, the
real skin is mapped. What is learned is learned on circles that the calibrated arm draws in simulation.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent))
import robot as nao
import triangles

import bodyimage_kin as bk
from bodyimage_kin import figures, metrics
from bodyimage_kin.body.clusters import touched_place
from bodyimage_kin.body_image import PostureSOM
from bodyimage_kin.calibration import Observed, calibrate

BLOCKS, STEPS, RESAMPLES = 20, 8000, 4
FREE = {
    "as it is drawn": (),
    "finger": ("hand",),
    "finger, mount": ("hand", "skin"),
    "finger, mount, zeros": ("hand", "skin", "offsets"),
    "all of the arm": ("hand", "skin", "offsets", "axes"),
}
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


@dataclass(frozen=True)
class Setting:
    """What every circle has in common.

    Attributes:
        body: The calibrated body.
        drawn: As it is drawn, seen by the same eye.
        touches: Those that are mapped.
        resamples: Draws of their blocks, beside all of them as they are.
    """

    body: bk.Embodiment
    drawn: bk.Embodiment
    touches: xr.Dataset
    resamples: int

    def rows(self, seed: int, draw: int) -> np.ndarray:
        """Samples of a draw of blocks, the same for every estimator; draw 0: all as they are."""
        block = self.touches["block"].values[0]
        if draw == 0:
            return np.arange(len(block))
        names = np.unique(block)
        drawn = np.random.default_rng([seed, draw]).choice(names, len(names))
        return np.concatenate([np.flatnonzero(block == one) for one in drawn])


def estimators(setting: Setting) -> dict[str, Any]:
    """All that are compared."""
    kinds = bk.estimators
    return {
        "least squares": kinds.LeastSquares(),
        "paper's network": kinds.PaperMLP(),
        "Gaussian process": kinds.GaussianProcess(),
        "TrigRidge": kinds.TrigRidge(),
        "RationalTrig": kinds.RationalTrig(),
        "SelfCalibration": kinds.SelfCalibration(setting.drawn),
        "analytic, as drawn": kinds.Analytic(setting.drawn),
        "analytic, calibrated": kinds.Analytic(setting.body),
    }


def unstuck(every: xr.Dataset) -> xr.Dataset:
    """The touches in postures that come back thrice at most: in others a taxel stays on."""
    _, same, times = np.unique(every["q"].values[0].round(3), axis=0, return_inverse=True, return_counts=True)
    return every.isel(time=np.flatnonzero(times[same.ravel()] <= 3))


def trusted(drawn: bk.Embodiment, every: xr.Dataset) -> tuple[xr.Dataset, dict[str, int]]:
    """The touches without those of a stuck taxel or a finger that is elsewhere, and how many these are.

    Once the finger is fitted, robustly and on every second block, a touch counts as elsewhere beyond the median
    distance and five robust standard deviations.
    """
    left = unstuck(every)
    even = np.flatnonzero(left["block"].values[0] % 2 == 0)
    fit = calibrate(drawn, Observed(left.isel(time=even), use=["touches"]), free=["hand"], folds=2)
    skin = fit.body.require_skin()
    tips = fit.body.hand_in_skin(left["q"].values[0]).numpy()
    places = [touched_place(skin.link_positions, active) for active in left["touched"].values[0]]
    away = np.array(
        [
            np.nan if at is None else np.linalg.norm(tip - skin.link_positions[at].mean(0))
            for tip, at in zip(tips, places, strict=True)
        ]
    )
    middle = np.nanmedian(away)
    far = away > middle + 5 * 1.4826 * np.nanmedian(np.abs(away - middle))
    counts = {"touches": every.sizes["time"], "stuck": int(every.sizes["time"] - left.sizes["time"])}
    counts |= {"elsewhere": int(far.sum())}
    return left.isel(time=np.flatnonzero(~far)), counts


def calibrated(
    what: nao.Touched, data: Path, quick: bool
) -> tuple[dict[str, Any], bk.Embodiment, bk.Embodiment, xr.Dataset]:
    """What was found of the body, the chosen one, the drawn one, and the touches to be mapped."""
    drawn = nao.nominal(what, data)
    every, counts = trusted(drawn, nao.touches(what, drawn, data, BLOCKS))
    odd = every["block"].values[0] % 2 == 1
    fitted, mapped = (every.isel(time=np.flatnonzero(rows)) for rows in (~odd, odd))
    # Five folds of contiguous blocks suffice.
    fitted = fitted.assign(block=fitted["block"] // 4)
    found, body = {}, None
    for name, free in FREE.items():
        if quick and name not in ("as it is drawn", "finger, mount"):
            continue
        fit = calibrate(drawn, Observed(fitted, use=["touches"]), free=free or ["hand"])
        error = (fit.held_out if free else fit.nominal).medians[0]
        found[name] = {"numbers": fit.free if free else 0, "held_out_mm": 1e3 * float(error)}
        if name == "finger, mount":
            body = fit.body
    assert body is not None
    eye = nao.eye(body.require_skin())
    told = {
        "touches": counts | {"calibrated": fitted.sizes["time"], "mapped": mapped.sizes["time"]},
        "calibration": found,
    }
    return told, nao.seen_by(body, eye), nao.seen_by(drawn, eye), mapped


def circle(setting: Setting, seed: int) -> dict[str, list[dict[str, float]]]:
    """All scores of one circle: estimator -> a table a draw of blocks."""
    torch.set_num_threads(1)
    body, touches = setting.body, setting.touches
    training = bk.simulate(body, bk.motions.Circle(), seed=seed, dynamics=False, noise=NOISE)
    q = touches["q"].values[0]
    true = body.hand_image_jacobian(q)
    metric = metrics.motion_metric(touches)
    sight = body.hand_image(q).numpy()
    found: dict[str, list[dict[str, float]]] = {}
    som = PostureSOM.fit(q, (8, 8), seed)
    images = {SIGHT: sight, CHANCE: sight}
    told: dict[str, dict[str, float]] = {SIGHT: {"jacobian": 0.0, "hand": 0.0}, CHANCE: {}}
    experience = bk.experience(training)
    exp, points = _referred(setting, sight), body.hand_in_camera(q)
    for name, estimator in estimators(setting).items():
        learned = estimator.fit(experience, seed=seed)
        images[name] = bk.integrate(exp, learned, path="star").values[0]
        away = metrics.error_in_space(images[name], points, body.camera.model)
        told[name] = {
            "jacobian": metrics.pooled_relative_error(true, learned.jacobian(q), metric),
            "hand": float(np.nanmedian(away)),
        }
    for name, image in images.items():
        found[name] = [
            told[name] | _map(setting, name, image, som, seed, draw) for draw in range(setting.resamples + 1)
        ]
    return found


def _referred(setting: Setting, sight: np.ndarray) -> xr.Dataset:
    """The touches, the one nearest to the middle taxel being the place from which all others are reached."""
    body, touches = setting.body, setting.touches
    skin = body.require_skin()
    away = np.linalg.norm(
        body.hand_in_skin(touches["q"].values[0]).numpy() - skin.link_positions[skin.reference], axis=1
    )
    there = np.zeros((1, len(away)), dtype=bool)
    there[0, away.argmin()] = True
    referred = touches.assign(at_reference=(("trial", "time"), there), reference_image=("axis", sight[away.argmin()]))
    return referred.assign_coords(axis=list(body.camera.model.names))


def _map(setting: Setting, name: str, image: np.ndarray, som: PostureSOM, seed: int, draw: int) -> dict[str, float]:
    """Scores of the map that these hand images lead to, on the taxels that were touched."""
    body, rows = setting.body, setting.rows(seed, draw)
    skin = body.require_skin()
    touches = setting.touches.isel(time=rows)
    if name == CHANCE:
        dealt = metrics.shuffled_touches(touches["touched"].values, seed)
        touches = touches.assign(touched=(touches["touched"].dims, dealt))
    learned = bk.BodyImage.learn(
        touches, image[rows][None], skin=skin, steps=STEPS, seed=seed, posture_som=som, snapshots=()
    )
    pose = body.camera.link_T_camera.numpy()
    points = (skin.link_positions - pose[:3, 3]) @ pose[:3, :3]
    true = body.camera.model.project(torch.from_numpy(points)).numpy()
    touched = learned.touch_counts > 0
    scores = metrics.scores(learned.tactile_map, true, touched)
    away = metrics.error_in_space(learned.tactile_map[touched], points[touched], body.camera.model)
    kept = {score: float(scores[score]) for score in ("disparity", "neighbours_kept", "trustworthiness", "scale")}
    return kept | {
        "map": float(np.median(away)),
        "relations": _relations(learned.tactile_map, true, touched, skin.units),
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


def summary(circles: list[dict[str, list[dict[str, float]]]]) -> dict[str, dict[str, list[float]]]:
    """Estimator -> score -> mean over circles, and the 2.5 and 97.5 % quantiles over circles and draws of blocks."""
    found: dict[str, dict[str, list[float]]] = {}
    for name in circles[0]:
        found[name] = {}
        for score in COLUMNS:
            if score in circles[0][name][0]:
                whole = [one[name][0][score] for one in circles]
                drawn = [draw[score] for one in circles for draw in one[name][1:]]
                found[name][score] = [float(np.mean(whole)), *map(float, np.quantile(drawn, [0.025, 0.975]))]
    return found


def pairs(circles: list[dict[str, list[dict[str, float]]]], score: str) -> dict[str, float]:
    """How often, over circles and draws, an estimator's map is nearer to the truth than that of least squares."""
    names = [name for name in circles[0] if name not in (SIGHT, CHANCE, "least squares")]
    return {
        name: float(
            np.mean(
                [a[score] < b[score] for one in circles for a, b in zip(one[name], one["least squares"], strict=True)]
            )
        )
        for name in names
    }


def page(results: Mapping[str, Any]) -> str:
    """The tables."""
    head = ["", *(title for title, _, _ in COLUMNS.values())]
    lines = [head, ["---"] + ["---:"] * len(COLUMNS)]
    for name, scores in results["scores"].items():
        cells = [name]
        for score, (_, factor, digits) in COLUMNS.items():
            if score not in scores:
                cells.append("")
                continue
            mean, low, high = (f"{factor * value:.{digits}f}" for value in scores[score])
            cells.append(mean if low == high == mean else f"{mean} [{low}, {high}]")
        lines.append(cells)
    calibration = [["calibrated", "numbers", "held-out touch, median [mm]"], ["---", "---:", "---:"]]
    calibration += [
        [name, str(one["numbers"]), f"{one['held_out_mm']:.2f}"] for name, one in results["calibration"].items()
    ]
    better = [["map nearer to the truth than that of least squares", "share of draws"], ["---", "---:"]]
    better += [[name, f"{share:.2f}"] for name, share in results["nearer_than_least_squares"].items()]
    return "\n".join("".join(f"| {' | '.join(row)} |\n" for row in table) for table in (calibration, lines, better))


@figures.style()
def draw(setting: Setting, file: Path) -> None:
    """The skin coloured by its touches, and maps of the first circle over the true places."""
    body, touches = setting.body, setting.touches
    skin = body.require_skin()
    pose = body.camera.link_T_camera.numpy()
    true = body.camera.model.project(torch.from_numpy((skin.link_positions - pose[:3, 3]) @ pose[:3, :3])).numpy()
    training = bk.simulate(body, bk.motions.Circle(), seed=0, dynamics=False, noise=NOISE)
    sight = body.hand_image(touches["q"].values[0]).numpy()
    exp = _referred(setting, sight)
    shown = ("least squares", "RationalTrig")
    images = {SIGHT: sight} | {
        name: bk.integrate(exp, estimators(setting)[name].fit(bk.experience(training), seed=0), path="star").values[0]
        for name in shown
    }
    figure, grid = figures.panels(2, 2, height=5.6)
    places = iter(grid.flat)
    counts = np.bincount(touches["touched"].values[touches["touched"].values >= 0], minlength=skin.count)
    counts = np.where(counts > 0, counts, np.nan)
    figures.skin(body, counts, next(places), flat=True, label="touches")
    for axes, (name, image) in zip(places, images.items(), strict=True):
        learned = bk.BodyImage.learn(exp, image[None], skin=skin, steps=STEPS, seed=0, snapshots=())
        touched = learned.touch_counts > 0
        edges = skin.neighbours[touched[skin.neighbours].all(1)]
        blank = np.where(touched[:, None], 1.0, np.nan)
        figures.tactile_map(learned.tactile_map * blank, axes, true=true * blank, neighbours=edges)
        axes.set_title(name)
    figures.letters(grid.flat)
    # A picture alone: a file with the values would hold the published places.
    figure.savefig(file, dpi=110)


def main() -> None:
    """Writes PART.json, PART.md and PART.png for each part that is touched, and the same of its triangles."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of the recordings")
    parser.add_argument("--circles", type=int, default=20, help="recordings that are learned from (default: 20)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--quick", action="store_true", help="two circles, one calibration")
    parser.add_argument(
        "--parts", nargs="+", default=["torso", "head"], choices=["torso", "head"], help="what is touched"
    )
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the results")
    parser.add_argument("--triangles", action="store_true", help="only whether triangles are where they are published")
    asked = parser.parse_args()
    recordings = {"torso": nao.TORSO, "head": nao.HEAD}
    asked.out.mkdir(parents=True, exist_ok=True)
    for part in asked.parts:
        what = recordings[part]
        if not (asked.data / "nao" / what.file).is_file():
            parser.exit(0, f"skipped: there is no nao/{what.file} in {asked.data}; --help says where it is from\n")
        # With those from elsewhere: on a misplaced triangle every touch is.
        drawn = nao.nominal(what, asked.data)
        found = triangles.misplaced(what, asked.data, unstuck(nao.touches(what, drawn, asked.data, BLOCKS)))
        (asked.out / f"{part}_triangles.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        (asked.out / f"{part}_triangles.md").write_text(triangles.table(found), encoding="utf-8")
        if asked.triangles:
            continue
        told, body, drawn, mapped = calibrated(what, asked.data, asked.quick)
        setting = Setting(body, drawn, mapped, RESAMPLES)
        with ProcessPoolExecutor(asked.workers) as pool:
            circles = list(pool.map(partial(circle, setting), range(2 if asked.quick else asked.circles)))
        scores = {"scores": summary(circles), "nearer_than_least_squares": pairs(circles, "map")}
        results = {"circles": len(circles), "resamples": RESAMPLES, **told, **scores}
        (asked.out / f"{part}.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        (asked.out / f"{part}.md").write_text(page(results), encoding="utf-8")
        draw(setting, asked.out / f"{part}.png")


if __name__ == "__main__":
    main()
