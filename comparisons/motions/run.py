"""Other motions in view against the paper's circle: ``python comparisons/motions/run.py``, results beside this file.

Every body is an infant with joints off by the default prior (axes 3 degrees, origins 5 mm), and makes one recording of
each motion, of equal time and with all noise. Some eight minutes of one quiet core; ``--quick`` for four bodies.
"""

from __future__ import annotations

import argparse
import json
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

import bodyimage_kin as bk
from bodyimage_kin import figures, metrics
from bodyimage_kin.errors import DataWarning, Unreachable
from bodyimage_kin.study.statistics import Comparison, Interval, compare, interval

HERE = Path(__file__).parent
NOISE = bk.Noise(torque=0.1, encoder=1e-3, image=2e-4)
CIRCLES = bk.motions.Circles()
MOTIONS: Mapping[str, bk.motions.Motion] = {
    # As many turns as there are in the time of the circles at three depths.
    "circle": bk.motions.Circle(turns=CIRCLES.duration * 0.05 / (4 * math.pi * 0.05)),
    "circles": CIRCLES,
    "two_radii": bk.motions.Circles((0.03, 0.03), (0.05, 0.03), turns=1.994),
    "lissajous": bk.motions.Lissajous(duration=CIRCLES.duration),
    "babbling": bk.motions.Babbling(duration=CIRCLES.duration),
}
_ACROSS = 3
"""Panels beside each other."""
LABELS = {"gaussian_process_tuned": "GP of degree 2"}
WORDS = {
    "circle": "the paper's circle, 3 cm in front",
    "circles": "circles at 2, 5 and 10 cm",
    "two_radii": "circles of 5 and 3 cm at 3 cm",
    "lissajous": "a Lissajous figure, 2 to 10 cm",
    "babbling": "babbling, 2 to 10 cm",
}
ESTIMATORS: Mapping[str, bk.estimators.Estimator] = {
    "least_squares": bk.estimators.LeastSquares(),
    "paper_mlp": bk.estimators.PaperMLP(steps=500),
    "kernel_ridge": bk.estimators.KernelRidge(),
    "gaussian_process": bk.estimators.GaussianProcess(),
    # As tuned on noisy recordings of the circle: comparisons/estimators/tuning.json.
    "gaussian_process_tuned": bk.estimators.GaussianProcess(degree=2),
    "rational_trig": bk.estimators.RationalTrig(roughness=16.0, iterations=2),
}


def of_body(body: bk.Embodiment, seed: int) -> dict[str, dict[str, float]]:
    """Motion -> estimator -> relative error on the face, in the metric of felt touching; likewise of the nominal body.

    That one has learned from no motion, and stands under the first; NaN where its hand is out of its sight.

    Raises:
        Unreachable: A body that cannot reach its whole face, or all of a motion.
    """
    q = body.touch_postures(range(body.skin.count))
    true = body.hand_image_jacobian(q)
    metric = metrics.motion_metric(bk.simulate(body, bk.motions.RandomTouch(duration=80.0), seed, noise=NOISE))
    found = {}
    for name, motion in MOTIONS.items():
        seen = bk.experience(bk.simulate(body, motion, seed, noise=NOISE))
        found[name] = {
            estimator: metrics.pooled_relative_error(true, spec.fit(seen, seed).jacobian(q).detach(), metric)
            for estimator, spec in ESTIMATORS.items()
        }
    drawn = bk.load_embodiment("infant").hand_image_jacobian(q, on_invisible="nan")
    seen_everywhere = bool(torch.isfinite(drawn).all())
    found["circle"]["nominal"] = metrics.pooled_relative_error(true, drawn, metric) if seen_everywhere else math.nan
    return found


def measured(count: int) -> tuple[dict[str, dict[str, list[float]]], list[float], int]:
    """Estimator -> motion -> error of each of so many bodies.

    Then that of the nominal body on each, and how many bodies could not do all of it and were drawn again.
    """
    rows: list[dict[str, dict[str, float]]] = []
    drawn = bk.calibration.drawn_bodies(bk.load_embodiment("infant"), 2 * count, seed=0)
    tried = 0
    for seed, body in enumerate(drawn):
        if len(rows) == count:
            break
        tried += 1
        try:
            rows.append(of_body(body, seed))
        except Unreachable:
            continue
        print(f"body {len(rows)} of {count}", flush=True)
    errors = {name: {motion: [row[motion][name] for row in rows] for motion in MOTIONS} for name in ESTIMATORS}
    return errors, [row["circle"]["nominal"] for row in rows], tried - len(rows)


def judged(errors: Mapping[str, Mapping[str, list[float]]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Estimator -> motion -> its error, and its ratio to that of the circle on the same bodies."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for name, of in errors.items():
        against = compare(of, "circle")
        found[name] = {}
        for motion, values in of.items():
            row: dict[str, Any] = {"error": _plain(interval(values)), "median": float(np.median(values))}
            if motion != "circle":
                one: Comparison = against[motion]
                row |= {
                    "ratio": _plain(one.ratio),
                    "p_holm": one.p_holm,
                    "better": int((np.array(values) < np.array(of["circle"])).sum()),
                }
            found[name][motion] = row
    return found


def _plain(one: Interval) -> list[float]:
    return [one.estimate, one.lower, one.upper]


@figures.labelled(LABELS)
def markdown(found: Mapping[str, Any]) -> str:
    """The table that is published."""
    count = found["bodies"]
    lines = [
        f"Relative error of the Jacobian on the face, in the metric of felt touching: mean over {count} bodies, one "
        f"recording each, all motions of {found['seconds']:.0f} s. In brackets 95 % over bodies (BCa); p by flipping "
        f"signs of paired log-ratios, adjusted over the four motions (Holm). {found['redrawn']} bodies that could not "
        "reach all of it were drawn again.",
        "",
        "| estimator | motion | error | median | ratio to the circle | p | less error, bodies |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for name, of in found["judged"].items():
        for motion, row in of.items():
            low, high = row["error"][1:]
            said = f"{row['error'][0]:.3f} [{low:.3f}, {high:.3f}] | {row['median']:.3f}"
            against = "| | "
            if "ratio" in row:
                ratio, least, most = row["ratio"]
                against = f"{ratio:.2f} [{least:.2f}, {most:.2f}] | {row['p_holm']:.2g} | {row['better']} of {count}"
            lines.append(f"| {figures.label(name)} | {WORDS[motion]} | {said} | {against} |")
    drawn = found["nominal"]
    unseen = f"; on {drawn['out_of_sight']} of {count} its hand leaves its sight" if drawn["out_of_sight"] else ""
    lines.append(f"| {figures.label('nominal')} | none, as it is drawn{unseen} | | {drawn['median']:.3f} | | |  |")
    return "\n".join(lines) + "\n"


@figures.style()
@figures.labelled(LABELS)
def draw(found: Mapping[str, Any], folder: Path) -> None:
    """A panel an estimator: the ratio to the circle, motion by motion."""
    rows = -(-len(found["judged"]) // _ACROSS)
    figure, grid = figures.panels(rows, _ACROSS, height=1.5 * rows, sharey=True, sharex=True)
    for axes in grid.flat[len(found["judged"]) :]:
        axes.set_axis_off()
    others = [motion for motion in MOTIONS if motion != "circle"]
    for axes, (name, of) in zip(grid.flat, found["judged"].items(), strict=False):
        ratios = np.array([of[motion]["ratio"] for motion in others])
        place = np.arange(len(others))[::-1]
        axes.axvline(1.0, color="0.6", linewidth=0.8)
        axes.errorbar(ratios[:, 0], place, xerr=np.abs(ratios[:, 1:] - ratios[:, :1]).T, fmt="o", color="black", ms=3)
        axes.set(title=figures.label(name), xscale="log")
        axes.set_xticks([0.5, 1.0, 2.0], ["0.5", "1", "2"])
        axes.minorticks_off()
        axes.set_yticks(place, [motion.replace("_", " ") for motion in others])
    for axes in grid[-1]:
        axes.set_xlabel("error over the circle's")
    figures.save(figure, folder, "ratios")


def main() -> None:
    """Computes everything; writes results.json, table.md and the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", type=int, default=30, help="bodies (default: 30)")
    parser.add_argument("--quick", action="store_true", help="four bodies")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the results")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    warnings.simplefilter("ignore", DataWarning)
    errors, nominal, redrawn = measured(4 if asked.quick else asked.bodies)
    found = {
        "bodies": len(errors["least_squares"]["circle"]),
        "redrawn": redrawn,
        "seconds": CIRCLES.duration,
        "errors": errors,
        "judged": judged(errors),
        "nominal": {
            "errors": [value if np.isfinite(value) else None for value in nominal],
            "median": float(np.nanmedian(nominal)),
            "out_of_sight": int(np.isnan(nominal).sum()),
        },
    }
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "results.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    (asked.out / "table.md").write_text(markdown(found), encoding="utf-8")
    draw(found, asked.out)
    print(markdown(found))


if __name__ == "__main__":
    main()
