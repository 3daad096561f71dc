"""Is the doubt about each taxel as large as its error? ``python comparisons/uncertainty/run.py``, results beside this.

Every body is an infant with joints off by the default prior (axes 3 degrees, origins 5 mm). It watches its hand on the
paper's circle, with all noise, then touches its face. Functions drawn from what was learned are integrated, each gives
a map, and their spread is held against the map of the true Jacobian, integrated alike, and that of direct sight.
Some six minutes of one quiet core; ``--quick`` for four bodies.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr

import bodyimage_kin as bk
from bodyimage_kin import figures, metrics
from bodyimage_kin.calibration import drawn_bodies
from bodyimage_kin.errors import BodyImageKinError, DataWarning, Unreachable
from bodyimage_kin.estimators import Learned
from bodyimage_kin.study.statistics import interval

HERE = Path(__file__).parent
NOISE = bk.Noise(torque=0.1, encoder=1e-3, image=2e-4)
LEVELS = (0.5, 0.9, 0.95)
DRAWS = 60
ESTIMATORS: Mapping[str, bk.estimators.Estimator] = {
    "ridge": bk.estimators.Ridge(),
    "paper_mlp_ensemble": bk.estimators.Ensemble(bk.estimators.PaperMLP(steps=500), members=10),
    "polynomial": bk.estimators.Polynomial(),
    "trig_ridge": bk.estimators.TrigRidge(),
    "kernel_ridge": bk.estimators.KernelRidge(),
    "gaussian_process": bk.estimators.GaussianProcess(),
    "rational_trig": bk.estimators.RationalTrig(roughness=16.0, iterations=2),
}
CALIBRATED = "calibrated_body"
SHOWN = (
    "error",
    "sharpness",
    "crps",
    "coverage_50",
    "coverage_90",
    "coverage_95",
    "sight_error",
    "sight_coverage_90",
    "truth_by_sight",
)


def learned_draws(name: str, seen: xr.Dataset, nominal: bk.Embodiment, seed: int) -> Sequence[Learned]:
    """Functions as plausible as what was learned from an experience."""
    if name == CALIBRATED:
        # The noise is estimated: what encoders add to that of the images nobody has to know.
        fit = bk.calibrate(nominal, seen, free=["axes", "offsets"], folds=2)
        return [bk.estimators.Analytic(one).fit(seen) for one in fit.draws(DRAWS, seed)]
    drawn: Sequence[Learned] = ESTIMATORS[name].fit(seen, seed).draws(DRAWS, seed)  # type: ignore[attr-defined]
    return drawn


def of_body(body: bk.Embodiment, nominal: bk.Embodiment, seed: int) -> dict[str, dict[str, Any]]:
    """Estimator -> scores of the doubt about the map, over all taxels, and whether the nose is within each region.

    Raises:
        Unreachable: A body that does not reach all of its face.
    """
    body.touch_postures(range(body.skin.count))
    seen = bk.experience(bk.simulate(body, bk.motions.Circle(), seed, noise=NOISE))
    recording = bk.simulate(body, bk.motions.RandomTouch(duration=120.0), seed, noise=NOISE)
    touch = bk.experience(recording)
    by_truth = bk.integrate(touch, bk.estimators.Analytic(body).fit(touch), method="midpoint")
    nose = body.skin.landmarks["nose"]
    found: dict[str, dict[str, Any]] = {}
    for name in (*ESTIMATORS, CALIBRATED):
        try:
            hands = bk.integrate_draws(touch, learned_draws(name, seen, nominal, seed), method="midpoint")
            maps = bk.BodyImageDraws.learn(touch, hands, snapshots=())
        except BodyImageKinError as problem:
            found[name] = {"failed": str(problem)}
            continue
        # The true maps begin where the others do and go through the same touches.
        start = maps.draws[0].config["image_range"]
        true, sight = (
            bk.BodyImage.learn(touch, hand, image_range=start, snapshots=()).tactile_map.reshape(-1, body.m)
            for hand in (by_truth, recording["true_hand_image"])
        )
        mean, covariance = maps.mean.reshape(-1, body.m), maps.covariance.reshape(-1, body.m, body.m)
        of_sight = metrics.uncertainty_scores(sight, mean, covariance)
        found[name] = metrics.uncertainty_scores(true, mean, covariance) | {
            "nose": metrics.coverage(true[[nose]], mean[[nose]], covariance[[nose]], LEVELS).share.tolist(),
            "sight_error": of_sight["error"],
            "sight_coverage_90": of_sight["coverage_90"],
            "truth_by_sight": float(np.sqrt(((true - sight) ** 2).sum(-1).mean())),
        }
    return found


def measured(count: int) -> list[dict[str, dict[str, Any]]]:
    """The scores of so many bodies that reach all of their face."""
    nominal = bk.load_embodiment("infant")
    rows: list[dict[str, dict[str, Any]]] = []
    for seed, body in enumerate(drawn_bodies(nominal, 2 * count, seed=0)):
        if len(rows) == count:
            break
        try:
            rows.append(of_body(body, nominal, seed))
        except Unreachable:
            continue
        print(f"body {len(rows)} of {count}", flush=True)
    return rows


def judged(rows: Sequence[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Estimator -> means over bodies with their intervals, and the exact interval of the nose's coverage."""
    found: dict[str, dict[str, Any]] = {}
    for name in (*ESTIMATORS, CALIBRATED):
        of = [row[name] for row in rows if "failed" not in row[name]]
        one: dict[str, Any] = {"bodies": len(of)}
        for score in SHOWN:
            mean = interval([row[score] for row in of])
            one[score] = [mean.estimate, mean.lower, mean.upper]
        within = np.array([row["nose"] for row in of]).sum(0).astype(int)
        # One taxel a body: bodies are independent, neighbouring taxels are not.
        one["nose"] = [[int(k), *_exact(int(k), len(of))] for k in within]
        found[name] = one
    return found


def _exact(within: int, count: int) -> tuple[float, float]:
    """The interval of Clopper and Pearson (1934)."""
    held = metrics.coverage(
        np.r_[np.zeros(within), np.full(count - within, 9.0)][:, None], np.zeros((count, 1)), np.ones((count, 1, 1))
    )
    return float(held.lower[-1]), float(held.upper[-1])


def markdown(found: Mapping[str, Any]) -> str:
    """The table that is published."""
    by_sight = 1e3 * found["judged"]["ridge"]["truth_by_sight"][0]
    lines = [
        f"Maps of {found['bodies']} bodies, {DRAWS} functions drawn from what each learned: root mean square error of "
        "a taxel's place, the error that the draws' spread foretells, and the share of taxels whose place by the true "
        "Jacobian, integrated alike, is within the region of 50, 90 and 95 %. In brackets 95 % over bodies (BCa). Then "
        "bodies whose nose is within its region of 90 %, with the exact binomial interval. Last, error and coverage of "
        f"90 % against direct sight, from which the true Jacobian's own map is {by_sight:.2f} mm off.",
        "",
        "| estimator | error [mm] | foretold [mm] | 50 % | 90 % | 95 % | nose, 90 % | by sight [mm] | by sight, 90 % |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, of in found["judged"].items():
        sizes = [f"{1e3 * of[score][0]:.2f}" for score in ("error", "sharpness")]
        shares = [
            f"{100 * mean:.0f} [{100 * low:.0f}, {100 * high:.0f}]"
            for mean, low, high in (of[f"coverage_{level}"] for level in (50, 90, 95))
        ]
        within, low, high = of["nose"][1]
        nose = f"{within} of {of['bodies']} [{100 * low:.0f}, {100 * high:.0f}]"
        sight = [f"{1e3 * of['sight_error'][0]:.2f}", f"{100 * of['sight_coverage_90'][0]:.0f}"]
        lines.append(f"| {figures.label(name)} | {' | '.join([*sizes, *shares, nose, *sight])} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Computes everything; writes results.json and table.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=20, help="bodies (default: 20)")
    parser.add_argument("--quick", action="store_true", help="four bodies")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the results")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", DataWarning)
    rows = measured(4 if asked.quick else asked.bodies)
    found = {"bodies": len(rows), "draws": DRAWS, "judged": judged(rows), "rows": rows}
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "results.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (asked.out / "table.md").write_text(markdown(found), encoding="utf-8")
    print(markdown(found))


if __name__ == "__main__":
    main()
