"""A real NAO touches itself: ``python comparisons/nao/run.py --data FOLDER``, tables and a figure beside this file.

FOLDER has ``nao/`` with ``torso_rightFinger.mat``, ``head_leftFinger.mat``, ``rightArm_torso.mat`` and the like, and
the folder ``Transformations``, all of the robot ``nao`` in ``ctu-vras/multirobot-calibration`` (``UserData/Robots``)
on GitHub. Torso and head take under three minutes of two quiet cores, what ``--arms`` and ``--doubt`` ask for some
more; ``--quick`` for a first look at two circles.

The touches are cut into 20 contiguous blocks. On every second one the body is calibrated; on the others, held out, the
real skin is mapped. What is learned is learned on circles that the calibrated arm draws in simulation.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parent))
import arms
import doubt
import fitting
import robot as nao
import triangles
from scoring import (
    CHANCE,
    NOISE,
    SIGHT,
    STEPS,
    Scores,
    Setting,
    nearer,
    rows_of,
    summary,
    table_of_fits,
    table_of_scores,
)

import bodyimage_kin as bk
from bodyimage_kin import figures, metrics


def estimators(setting: Setting) -> dict[str, Any]:
    """All that are compared."""
    kinds = bk.estimators
    return {
        "least squares": kinds.LeastSquares(),
        "Ridge": kinds.Ridge(),
        "paper's network": kinds.PaperMLP(),
        "PostureMLP": kinds.PostureMLP(),
        "JacobianNetwork": kinds.JacobianNetwork(),
        "ForwardNetwork": kinds.ForwardNetwork(),
        "NearestNeighbours": kinds.NearestNeighbours(),
        "LocallyWeighted": kinds.LocallyWeighted(),
        "Gaussian process": kinds.GaussianProcess(),
        "KernelRidge": kinds.KernelRidge(),
        "TrigRidge": kinds.TrigRidge(),
        "cubic polynomial": kinds.Polynomial(degree=3),
        "RationalTrig": kinds.RationalTrig(),
        "RationalPolynomial": kinds.RationalPolynomial(degree=2),
        "SelfCalibration": kinds.SelfCalibration(setting.drawn),
        "analytic, as drawn": kinds.Analytic(setting.drawn),
        "analytic, calibrated": kinds.Analytic(setting.body),
    }


def circle(setting: Setting, seed: int) -> Scores:
    """All scores of one circle."""
    torch.set_num_threads(1)
    body, q = setting.body, setting.q
    experience = bk.experience(bk.simulate(body, bk.motions.Circle(), seed=seed, dynamics=False, noise=NOISE))
    sight, true, points = body.hand_image(q).numpy(), body.hand_image_jacobian(q), body.hand_in_camera(q)
    metric, exp = metrics.motion_metric(setting.touches), setting.referred()
    images = {SIGHT: sight, CHANCE: sight}
    told: dict[str, dict[str, float]] = {SIGHT: {"jacobian": 0.0, "hand": 0.0}}
    for name, estimator in estimators(setting).items():
        learned = estimator.fit(experience, seed=seed)
        images[name] = bk.integrate(exp, learned, path="star").values[0]
        away = metrics.error_in_space(images[name], points, body.camera.model)
        told[name] = {
            "jacobian": metrics.pooled_relative_error(true, learned.jacobian(q), metric),
            "hand": float(np.nanmedian(away)),
        }
    return setting.scores(images, told, seed)


def page(results: Mapping[str, Any]) -> str:
    """The tables."""
    better = [["map nearer to the truth than that of least squares", "share of draws"], ["---", "---:"]]
    better += [[name, f"{share:.2f}"] for name, share in results["nearer_than_least_squares"].items()]
    tables = (table_of_fits(results["calibration"]), table_of_scores(results["scores"]), rows_of(better))
    return "\n".join(tables)


@figures.style()
def draw(setting: Setting, file: Path) -> None:
    """The skin coloured by its touches, and maps of the first circle over the true places."""
    body, touches = setting.body, setting.touches
    skin = body.require_skin()
    _, true = setting.true_places()
    training = bk.simulate(body, bk.motions.Circle(), seed=0, dynamics=False, noise=NOISE)
    exp = setting.referred()
    shown = ("least squares", "RationalTrig")
    images = {SIGHT: body.hand_image(setting.q).numpy()} | {
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
    parser.add_argument("--circles", type=int, help="recordings that are learned from (default: 20; of doubt: 10)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--quick", action="store_true", help="two circles, one calibration")
    parser.add_argument(
        "--parts",
        nargs="+",
        default=["torso", "head"],
        choices=list(nao.RECORDINGS),
        help="what is touched, and by what",
    )
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the results")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--arms", action="store_true", help="what the skins of the arms touch, in place of the fingers")
    only.add_argument("--triangles", action="store_true", help="only whether triangles are where they are published")
    only.add_argument(
        "--doubt", action="store_true", help="only whether the doubt about the torso's map is as its error"
    )
    asked = parser.parse_args()
    torch.set_num_threads(1)
    asked.out.mkdir(parents=True, exist_ok=True)
    parts = ["torso"] if asked.doubt else asked.parts
    if asked.arms:
        parts = [name for name, what in nao.BY_ARM.items() if what.part in asked.parts]
    for part in parts:
        if not (asked.data / "nao" / nao.RECORDINGS[part].file).is_file():
            parser.exit(
                0,
                f"skipped: there is no nao/{nao.RECORDINGS[part].file} in {asked.data}; --help says where it is from\n",
            )
    wanted = asked.circles or (10 if asked.doubt else 20)
    seeds = range(2 if asked.quick else wanted)
    with ProcessPoolExecutor(asked.workers) as pool:
        for part in parts:
            what = nao.RECORDINGS[part]
            if what.by == "finger" and not asked.doubt:
                moved = pool.submit(triangles.misplaced, what, asked.data)
                if asked.triangles:
                    _write(asked.out / f"{part}_triangles", moved.result(), triangles.table(moved.result()))
                    continue
            found = fitting.found(what, asked.data, asked.quick)
            setting = Setting.of(found)
            if asked.doubt:
                results = doubt.results(list(pool.map(partial(doubt.circle, found), seeds)))
                _write(asked.out / f"{part}_doubt", results, doubt.page(results))
            elif what.by == "arm":
                results = arms.results(found, list(pool.map(partial(arms.circle, found), seeds)))
                _write(asked.out / part, results, arms.page(results))
            else:
                circles = list(pool.map(partial(circle, setting), seeds))
                told = {"circles": len(circles), "resamples": setting.resamples, **found.told}
                results = told | {"scores": summary(circles), "nearer_than_least_squares": nearer(circles)}
                _write(asked.out / part, results, page(results))
                _write(asked.out / f"{part}_triangles", moved.result(), triangles.table(moved.result()))
                draw(setting, asked.out / f"{part}.png")


def _write(file: Path, results: Mapping[str, Any], text: str) -> None:
    file.with_suffix(".json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    file.with_suffix(".md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
