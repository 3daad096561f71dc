"""Is the doubt about each taxel of the torso as large as its error? ``run.py --doubt``.

Functions as plausible as what was learned are integrated to the same touches, each gives a map, and their spread is
held against where the taxels are published to be. Beside it the same with the blocks of touches drawn anew for each
function, for a map is also only as good as the touches it saw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import robot as nao
import scipy.stats
import torch
from fitting import Found
from scoring import NOISE, STEPS, Setting, rows_of

import bodyimage_kin as bk
from bodyimage_kin import metrics
from bodyimage_kin.body_image import PostureSOM
from bodyimage_kin.calibration import Observed, calibrate

DRAWS, SUBSTEPS = 40, 10
LEVELS = (50, 90, 95)
KINDS = {"functions": "functions drawn", "touches": "and touches drawn anew"}
"""What differs from draw to draw."""
TRUTHS = {"published": "published places", "sight": "direct sight's map"}


def draws(found: Found, setting: Setting, seed: int) -> dict[str, Sequence[Any]]:
    """Estimator -> functions as plausible as what it learned from one circle, or from the other touches."""
    kinds = bk.estimators
    experience = bk.experience(bk.simulate(setting.body, found.what.circle, seed=seed, dynamics=False, noise=NOISE))
    seen = Observed(experience, use=["images"], noise={"images": NOISE.image})
    fit = calibrate(setting.drawn, seen, free=["hand", "axes", "offsets"], folds=2)
    eye = setting.body.camera
    bodies = {
        "SelfCalibration": fit.draws(DRAWS, seed),
        "calibrated by touch": [nao.seen_by(one, eye) for one in found.fit.draws(DRAWS, seed)],
    }
    learners = {
        "Gaussian process": kinds.GaussianProcess(),
        "TrigRidge": kinds.TrigRidge(),
        "RationalTrig": kinds.RationalTrig(),
    }
    drawn: dict[str, Sequence[Any]] = {
        name: one.fit(experience, seed=seed).draws(DRAWS, seed) for name, one in learners.items()
    }
    return drawn | {name: [kinds.Analytic(one).fit(experience) for one in of] for name, of in bodies.items()}


def circle(found: Found, seed: int) -> dict[str, dict[str, Any]]:
    """Estimator, what is drawn and which truth -> scores over the taxels that were touched [mm at their depth]."""
    torch.set_num_threads(1)
    setting = Setting.of(found)
    exp, body = setting.referred(), setting.body
    points, true = setting.true_places()
    som = PostureSOM.fit(setting.q, (8, 8), seed)
    bounds = np.stack([true.min(0), true.max(0)], axis=1)

    def learned(hand: np.ndarray, draw: int) -> bk.BodyImage:
        rows = setting.rows(seed, draw)
        return bk.BodyImage.learn(
            exp.isel(time=rows), hand[rows][None], skin=body.require_skin(), steps=STEPS, seed=seed,
            posture_som=som, image_range=bounds, snapshots=(),
        )  # fmt: skip

    truths = {"published": true, "sight": learned(body.hand_image(setting.q).numpy(), 0).tactile_map}
    # From the screen to the taxel's depth.
    depth = 1e3 * points[:, 2] / nao.SCREEN
    found_of: dict[str, dict[str, Any]] = {}
    for name, functions in draws(found, setting, seed).items():
        hands = bk.integrate_draws(exp, functions, path="star", substeps=SUBSTEPS).values[:, 0]
        for kind in KINDS:
            maps = bk.BodyImageDraws(
                tuple(learned(hand, draw if kind == "touches" else 0) for draw, hand in enumerate(hands, 1))
            )
            touched = maps.touch_counts > 0
            scale = depth[touched, None]
            mean, covariance = scale * maps.mean[touched], scale[..., None] ** 2 * maps.covariance[touched]
            for truth, places in truths.items():
                scores = metrics.uncertainty_scores(scale * places[touched], mean, covariance)
                found_of[f"{name}/{kind}/{truth}"] = scores | {"triangles": _triangles(body, touched)}
    return found_of


def _triangles(body: bk.Embodiment, touched: np.ndarray) -> int:
    return len(np.unique(body.require_skin().units[touched]))


def results(circles: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Means over circles; of shares, the exact binomial interval of as many independent places as there are triangles.

    Taxels of a triangle are felt together and err together.
    """
    judged: dict[str, Any] = {}
    for key in circles[0]:
        name, kind, truth = key.split("/")
        one: dict[str, Any] = {}
        for score in ("error", "sharpness", "crps"):
            values = [circle[key][score] for circle in circles]
            one[score] = [float(np.mean(values)), float(min(values)), float(max(values))]
        count = int(min(circle[key]["triangles"] for circle in circles))
        for level in LEVELS:
            share = float(np.mean([circle[key][f"coverage_{level}"] for circle in circles]))
            ends = scipy.stats.binomtest(round(share * count), count).proportion_ci(0.95, "exact")
            one[f"coverage_{level}"] = [share, float(ends.low), float(ends.high)]
        judged.setdefault(name, {}).setdefault(kind, {})[truth] = one | {"triangles": count}
    return {"circles": len(circles), "draws": DRAWS, "judged": judged}


def page(found: Mapping[str, Any]) -> str:
    """A row an estimator, what is drawn and which truth."""
    head = ["estimator", "draws", "truth", "error [mm]", "foretold [mm]", *(f"within {level} %" for level in LEVELS)]
    lines = [head, ["---"] * 3 + ["---:"] * (len(head) - 3)]
    for name, kinds in found["judged"].items():
        for kind, truths in kinds.items():
            for truth, one in truths.items():
                shares = (one[f"coverage_{level}"] for level in LEVELS)
                lines.append(
                    [
                        name, KINDS[kind], TRUTHS[truth], f"{one['error'][0]:.1f}", f"{one['sharpness'][0]:.1f}",
                        *(f"{100 * mean:.0f} [{100 * low:.0f}, {100 * high:.0f}]" for mean, low, high in shares),
                    ]
                )  # fmt: skip
    return rows_of(lines)
