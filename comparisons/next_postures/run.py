"""Ten postures aimed at what is asked against ten on a circle: thirty arms drawn from the prior, paired.

    python comparisons/next_postures/run.py

Each arm is the body as it is thought to be, its axes and offsets off as the prior says (or by twice as much). It is
calibrated on images of a few postures and asked where it was not seen: on its face, or anywhere in its joint space.
Writes results.json, table.md and figure.svg beside this file.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

import bodyimage_kin as bk
from bodyimage_kin import figures, metrics
from bodyimage_kin.calibration import Calibrated, Observed, calibrate
from bodyimage_kin.study import statistics

HERE = Path(__file__).parent
COUNTS = (5, 10, 20)
NEAREST = 0.02
"""A hand nearer to the camera's plane is not scored: its image moves without bounds [m]."""
FREE = ("axes", "offsets")
INDUSTRIAL = [
    (0.15, 0.45, -math.pi / 2, 0.0), (0.61, 0.0, math.pi, -math.pi / 2), (0.2, 0.0, -math.pi / 2, 0.0),
    (0.0, -0.64, math.pi / 2, 0.0), (0.03, 0.0, math.pi / 2, -math.pi / 2), (0.0, 0.2, 0.0, 0.0),
]  # fmt: skip
"""A six-axis arm of the usual kind: a, d [m], alpha, offset [rad]."""


def industrial() -> bk.Embodiment:
    """A six-axis arm before a camera that stands two metres away."""
    robot = bk.Robot.from_dh(INDUSTRIAL, joints=list("SLURBT"), name="six_axis_arm")
    # Looks back at the base along -x of the root, image down along -z.
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose[:3, 3] = [2.5, 0.0, 0.8]
    camera = bk.Camera(robot.root, pose, bk.Pinhole(fx=900.0, fy=900.0, cx=640.0, cy=480.0, size=(1280, 960)))
    hand = bk.Hand(robot.link_names[-1], offset=(0.0, 0.05, 0.1))
    home = dict(zip("SLURBT", (0.0, 0.3, 0.2, 0.0, 0.6, 0.0), strict=True))
    return bk.Embodiment.build(robot, joints=list("SLURBT"), hand=hand, camera=camera, home=home)


def images(body: bk.Embodiment, q: np.ndarray, noise: float, seed: int) -> Any:
    """What a body shows in these postures."""
    with torch.no_grad():
        image = body.hand_image(torch.from_numpy(q), on_invisible="nan").numpy()
    image = image + noise * np.random.default_rng([seed, 1]).standard_normal(image.shape)
    unit = body.camera.model.unit
    return bk.recording(q=q, hand_image=image, joints=list(body.joints), order="scattered", unit=unit)


def fitted(body: bk.Embodiment, exp: Any, noise: float) -> Calibrated:
    """The body that explains these images best."""
    return calibrate(body, Observed(exp, noise={"images": noise}), free=FREE, robust=False, folds=2)


def error(true: bk.Embodiment, found: bk.Embodiment, q: torch.Tensor) -> float:
    """Relative error of the Jacobian where it is asked for and both see the hand."""
    with torch.no_grad():
        J, Jh = (one.hand_image_jacobian(q, on_invisible="nan").numpy() for one in (true, found))
        there = (true.hand_in_camera(q)[:, 2] > NEAREST) & (found.hand_in_camera(q)[:, 2] > NEAREST)
    kept = there.numpy() & np.isfinite(J).all((1, 2)) & np.isfinite(Jh).all((1, 2))
    return float(metrics.pooled_relative_error(J[kept], Jh[kept]))


def on_circle(body: bk.Embodiment, motion: Any, count: int) -> np.ndarray:
    """So many postures, evenly along one turn."""
    seen = bk.simulate(body, motion, seed=0, dynamics=False)
    q = seen["q"].values[0]
    q = q[np.isfinite(seen["hand_image"].values[0]).all(-1)]
    return q[np.arange(count) * len(q) // count]


def drawn(thought: Calibrated, sd: np.ndarray, q: torch.Tensor) -> Iterator[tuple[int, bk.Embodiment]]:
    """Arms that are off by so much, of which the hand stays before the eye where the Jacobian is asked for."""
    for arm in itertools.count():
        true = thought.at(sd * np.random.default_rng([arm, 0]).standard_normal(len(sd)))
        if (true.hand_in_camera(q)[:, 2] > NEAREST).double().mean() > 0.9:
            yield arm, true


def compared(
    body: bk.Embodiment, probe: Any, motion: Any, noise: float, arms: int, factor: float, counts: tuple[int, ...]
) -> dict[str, Any]:
    """Errors of arms that were seen in aimed postures, in batches with refitting, and on a circle.

    Args:
        body: As it is thought to be.
        probe: Where the Jacobian is asked for.
        motion: The circle.
        noise: Standard deviation of the images [their unit].
        arms: How many are drawn.
        factor: How many times as far as the prior says they are off.
        counts: Numbers of postures.
    """
    chosen = {n: bk.next_postures(body, None, probe, n, noise=noise) for n in counts}
    thought = fitted(body, images(body, chosen[10].q, noise, 0), noise)
    sd = np.where(thought.fit.free, thought.prior.sds(thought.parameters), 0.0)
    q = probe.postures(body, None)
    q = q[:: max(1, len(q) // 63)]
    postures = {f"aimed {n}": chosen[n].q for n in counts}
    postures |= {f"circle {n}": on_circle(body, motion, n) for n in counts}
    errors: dict[str, list[float]] = {"nominal": [], **{name: [] for name in postures}, "aimed 10, refitted": []}
    first = bk.next_postures(body, None, probe, 5, noise=noise).q
    for arm, true in itertools.islice(drawn(thought, factor * sd, q), arms):
        errors["nominal"].append(error(true, body, q))
        for name, where in postures.items():
            found = fitted(body, images(true, where, noise, arm), noise)
            errors[name].append(error(true, found.body, q))
        # Five, a fit, five more that this fit finds best.
        more = bk.next_postures(body, images(true, first, noise, arm), probe, 5, noise=noise).q
        found = fitted(body, images(true, np.concatenate([first, more]), noise, arm), noise)
        errors["aimed 10, refitted"].append(error(true, found.body, q))
        print(arm, {name: round(values[-1], 4) for name, values in errors.items()}, flush=True)
    predicted = {f"aimed {n}": float(chosen[n].predicted_error[-1]) for n in counts}
    predicted["one by one 10"] = float(
        bk.next_postures(body, None, probe, 10, noise=noise, exchange=False).predicted_error[-1]
    )
    ratios = {}
    for n in counts:
        ratio = statistics.compare({"circle": errors[f"circle {n}"], "aimed": errors[f"aimed {n}"]}, "circle")["aimed"]
        ratios[str(n)] = [ratio.ratio.estimate, ratio.ratio.lower, ratio.ratio.upper]
    medians = {name: float(np.median(values)) for name, values in errors.items()}
    return {"medians": medians, "predicted": predicted, "ratios": ratios, "errors": errors}


def main() -> None:
    """Runs all settings and writes what came out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=30)
    parser.add_argument("--out", type=Path, default=HERE)
    asked = parser.parse_args()
    infant, arm = bk.load_embodiment("infant"), industrial()
    face, anywhere = bk.probes.Face(), bk.probes.JointSpace(count=63)
    circle, wide = bk.motions.Circle(turns=1.0), bk.motions.Circle(turns=1.0, radius=0.25, distance=1.5)
    begin = time.monotonic()
    found = {
        "infant": compared(infant, face, circle, 2e-4, asked.arms, 1.0, COUNTS),
        "infant, twice as far off": compared(infant, face, circle, 2e-4, asked.arms, 2.0, (10,)),
        "six-axis arm": compared(arm, anywhere, wide, 0.5, asked.arms, 1.0, (10, 20)),
    }
    print(f"{time.monotonic() - begin:.0f} s")
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "results.json").write_text(json.dumps(found, indent=1) + "\n")
    (asked.out / "table.md").write_text(table(found))
    draw(found, asked.out)


def table(found: dict[str, Any]) -> str:
    """Medians, quartiles, what was foretold, and the paired ratio to the circle."""
    lines = [
        "| body | postures | median error | quartiles | foretold | over the circle's, paired |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for body, of in found.items():
        for name, errors in of["errors"].items():
            low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75])
            foretold = f"{of['predicted'][name]:.3g}" if name in of["predicted"] else ""
            ratio = of["ratios"].get(name.removeprefix("aimed ")) if name.startswith("aimed") else None
            said = f"{ratio[0]:.2f} [{ratio[1]:.2f}, {ratio[2]:.2f}]" if ratio else ""
            lines.append(f"| {body} | {name} | {middle:.3g} | {low:.3g} to {high:.3g} | {foretold} | {said} |")
    return "\n".join(lines) + "\n"


def draw(found: dict[str, Any], folder: Path) -> None:
    """Every arm: its error after ten aimed postures over that after ten on the circle."""
    with figures.style():
        figure, grid = figures.panels(1, len(found), height=2.6, sharex=True, sharey=True)
        for axes, (body, of) in zip(grid[0], found.items(), strict=True):
            x, y = of["errors"]["circle 10"], of["errors"]["aimed 10"]
            axes.loglog(x, y, linestyle="", marker="o", color="#c2407e", markersize=3, label="one arm")
            ends = np.array([1e-3, 3.0])
            axes.plot(ends, ends, color="0.5", linestyle=(0, (2, 2)), linewidth=0.7, label="as good as the circle")
            axes.plot(ends, ends / 5, color="0.5", linewidth=0.7, label="a fifth of its error")
            axes.set(title=body, xlabel="error after 10 on the circle", xlim=(5e-3, 2), ylim=(1e-3, 2))
        grid[0, 0].set_ylabel("error after 10 aimed postures")
        figures.legend(figure)
    figures.save(figure, folder, "figure")


if __name__ == "__main__":
    main()
