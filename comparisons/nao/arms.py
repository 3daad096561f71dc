"""The skin of an arm as a second hand: it touches torso and head with many taxels at once, in many places of its own.

Who knows the body knows where each place of the arm's skin is seen, for it carries ``hand_offset`` along. A learner
without structure saw one point on its circle, the one that touches most, and its Jacobian is of that point: of other
places it knows nothing, so it is asked of the touches within a taxel and a half of that point alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import robot as nao
import torch
from fitting import Found
from scoring import CHANCE, NOISE, SIGHT, Scores, Setting, nearer, summary, table_of_fits, table_of_scores

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.calibration import Observed, calibrate

ALL_WIN = "direct sight, all taxels felt win"
ONE_POINT = "direct sight of that one point"


def circle(found: Found, seed: int) -> tuple[Scores, Scores]:
    """All scores of one circle: of all touches by those who carry an offset, and of those near the point by all."""
    torch.set_num_threads(1)
    everywhere = Setting.of(found)
    body = everywhere.body
    experience = bk.experience(bk.simulate(body, found.what.circle, seed=seed, dynamics=False, noise=NOISE))
    seen = Observed(experience, use=["images"], noise={"images": NOISE.image})
    fit = calibrate(everywhere.drawn, seen, free=["hand", "axes", "offsets"], folds=2)
    knowing = {"SelfCalibration": fit.body, "analytic, as drawn": everywhere.drawn, "analytic, calibrated": body}
    offsets = dict.fromkeys(knowing, everywhere.drawn_offset[0])
    offsets["SelfCalibration"] = fit.hand_offset(offsets["SelfCalibration"])
    offsets["analytic, calibrated"] = everywhere.offset
    return (
        _carried(everywhere, knowing, offsets, seed),
        _of_one_point(nearby(everywhere), knowing, experience, seed),
    )


def nearby(setting: Setting) -> Setting:
    """The touches by places of the arm's skin that are as good as the one that touches most."""
    near = np.linalg.norm(setting.offset - setting.body.hand.offset.numpy(), axis=1) < nao.NEAR
    rows = np.flatnonzero(near)
    return replace(setting, touches=setting.touches.isel(time=rows), drawn_offset=setting.drawn_offset[:, rows])


def _carried(
    setting: Setting, knowing: Mapping[str, bk.Embodiment], offsets: Mapping[str, np.ndarray], seed: int
) -> Scores:
    """Everyone begins at the same image of the touch that is nearest to the middle taxel."""
    sight = setting.body.hand_image(setting.q, setting.offset).numpy()
    sight = setting.body.hand_image(setting.q, setting.offset).numpy()
    points = setting.body.hand_in_camera(setting.q, setting.offset)
    first = int(setting.referred()["at_reference"].values[0].argmax())
    images = {SIGHT: sight, CHANCE: sight}
    told = {SIGHT: {"hand": 0.0}}
    for name, body in knowing.items():
        image = body.hand_image(setting.q, offsets[name]).numpy()
        images[name] = image + sight[first] - image[first]
        away = metrics.error_in_space(images[name], points, setting.body.camera.model)
        told[name] = {"hand": float(np.nanmedian(away))}
    scores = setting.scores(images, told, seed)
    return scores | replace(setting, winners="largest").scores({ALL_WIN: sight}, {ALL_WIN: {"hand": 0.0}}, seed)


def _of_one_point(setting: Setting, knowing: Mapping[str, bk.Embodiment], experience: Any, seed: int) -> Scores:
    """The Jacobian of one point, integrated; where the touched place is beside it, that is not known."""
    kinds, body, q = bk.estimators, setting.body, setting.q
    learners = {
        "least squares": kinds.LeastSquares(),
        "paper's network": kinds.PaperMLP(),
        "Gaussian process": kinds.GaussianProcess(),
        "TrigRidge": kinds.TrigRidge(),
        "RationalTrig": kinds.RationalTrig(),
    } | {name: kinds.Analytic(one) for name, one in knowing.items()}
    true, points = body.hand_image_jacobian(q), body.hand_in_camera(q, setting.offset)
    metric, exp = metrics.motion_metric(setting.touches), setting.referred()
    images = {SIGHT: body.hand_image(q, setting.offset).numpy(), ONE_POINT: body.hand_image(q).numpy()}
    images[CHANCE] = images[SIGHT]
    learned = {name: one.fit(experience, seed=seed) for name, one in learners.items()}
    images |= {name: bk.integrate(exp, one, path="star").values[0] for name, one in learned.items()}
    told: dict[str, dict[str, float]] = {
        name: {"hand": float(np.nanmedian(metrics.error_in_space(image, points, body.camera.model)))}
        for name, image in images.items()
        if name != CHANCE
    }
    for name, one in learned.items():
        told[name]["jacobian"] = metrics.pooled_relative_error(true, one.jacobian(q), metric)
    return setting.scores(images, told, seed)


def results(found: Found, circles: list[tuple[Scores, Scores]]) -> dict[str, Any]:
    """What is written down."""
    carried, near = ([one[which] for one in circles] for which in (0, 1))
    setting = Setting.of(found)
    few = nearby(setting)
    return {
        "circles": len(circles),
        "resamples": setting.resamples,
        **found.told,
        "taxels": int(carried[0][SIGHT][0]["taxels"]),
        "near": {"touches": len(few.q), "taxels": int(near[0][SIGHT][0]["taxels"]), "within_mm": 1e3 * nao.NEAR},
        "scores": summary(carried),
        "scores_near": summary(near),
        "nearer_than_least_squares": nearer(near),
    }


def page(results: Mapping[str, Any]) -> str:
    """The tables."""
    near = results["near"]
    return "\n".join(
        [
            table_of_fits(results["calibration"]),
            f"All {results['touches']['mapped']} touches, with {results['taxels']} taxels in their middle; it is known "
            "where on the arm's skin each was.\n",
            table_of_scores(results["scores"]),
            f"The {near['touches']} touches, with {near['taxels']} taxels in their middle, by places within "
            f"{near['within_mm']:.0f} mm of the one that touches most; whose Jacobian is of that point alone.\n",
            table_of_scores(results["scores_near"]),
        ]
    )
