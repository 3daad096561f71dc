"""How long a calibration takes, and a score without a truth: ``python comparisons/speed/calibration.py``.

A six-axis arm, 1,000 poses, a tracker's points, 36 numbers (six a joint) with a prior: ours, with exact derivatives,
against what one writes first, ``scipy.optimize.least_squares`` with finite differences over a loop of Pinocchio's
forward kinematics. Same start, same cost, same tolerances, in turns; then eight estimators scored on 500 poses.
Processor times, so that a busy machine does not count. Writes calibration.md and calibration.json beside this file.
"""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pinocchio
import scipy.optimize

import bodyimage_kin as bk
from bodyimage_kin.calibration import Observed
from bodyimage_kin.calibration.problem import Problem
from bodyimage_kin.cli.score import ESTIMATORS
from bodyimage_kin.estimators.map_fit import maximum_a_posteriori

HERE = Path(__file__).parent
ROWS = [
    (0.15, 0.45, -math.pi / 2, 0.0), (0.61, 0.0, math.pi, -math.pi / 2), (0.2, 0.0, -math.pi / 2, 0.0),
    (0.0, -0.64, math.pi / 2, 0.0), (0.03, 0.0, math.pi / 2, -math.pi / 2), (0.0, 0.2, 0.0, 0.0),
]  # fmt: skip
POINT = np.array([0.04, -0.02, 0.1])
TOLERANCE = 1e-10
SD = np.tile([5e-3, 5e-3, 5e-3, 0.05, 0.05, 0.02], 6)
NOISE = 1e-4


def arm() -> bk.Embodiment:
    """Six axes, seen by a tracker whose frame is the arm's own."""
    robot = bk.Robot.from_dh(ROWS, joints=list("SLURBT"), name="six_axis_arm")
    hand = bk.Hand(robot.link_names[-1], offset=POINT)
    camera = bk.Camera(robot.root, np.eye(4), bk.Tracker())
    return bk.Embodiment.build(robot, joints=list("SLURBT"), hand=hand, camera=camera, home={})


class ByDifferences:
    """The same cost over a loop of Pinocchio."""

    def __init__(self, body: bk.Embodiment, q: np.ndarray, observed: np.ndarray) -> None:
        self.model = pinocchio.buildModelFromXML(body.robot.to_urdf())
        self.data = self.model.createData()
        self.frame = self.model.getFrameId(body.hand.link, pinocchio.BODY)
        self.origins = [self.model.jointPlacements[k].copy() for k in range(1, self.model.njoints)]
        order = [self.model.names[k] for k in range(1, self.model.njoints)]
        self.q = np.ascontiguousarray(q[:, [body.joints.index(name) for name in order]])
        self.observed = observed

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Predicted less observed over the noise, and the prior."""
        model, data, frame = self.model, self.data, self.frame
        for k, origin in enumerate(self.origins):
            shift, turn = theta[6 * k : 6 * k + 3], theta[6 * k + 3 : 6 * k + 6]
            model.jointPlacements[k + 1] = origin * pinocchio.SE3(pinocchio.exp3(turn), shift)
        found = np.empty_like(self.observed)
        for row, q in enumerate(self.q):
            pinocchio.forwardKinematics(model, data, q)
            found[row] = pinocchio.updateFramePlacement(model, data, frame).act(POINT)
        return np.concatenate([((found - self.observed) / NOISE).ravel(), theta / SD])

    def fit(self) -> np.ndarray:
        """The most probable numbers."""
        end = scipy.optimize.least_squares(
            self.residual, np.zeros(36), x_scale=SD, xtol=TOLERANCE, ftol=TOLERANCE, gtol=TOLERANCE
        )
        return np.asarray(end.x)


def timed(call: object) -> tuple[float, object]:
    """Processor time [s], and what came out."""
    begin = time.process_time()
    result = call()  # type: ignore[operator]
    return time.process_time() - begin, result


def main() -> None:
    """Measures in turns and writes both files."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    body, rng = arm(), np.random.default_rng(0)
    q = body.felt_robot.sample(1000, seed=1).numpy()
    seen = body.hand_image(q).numpy()
    exp = bk.recording(q=q, hand_image=seen, joints=list(body.joints), order="scattered", unit="m")
    problem = Problem.of(body, [Observed(exp, noise={"images": NOISE})])
    (term,) = problem.terms
    theta = np.zeros(len(problem.parametric.parameters))
    free = np.arange(len(theta)) < 36
    theta[free] = SD * rng.standard_normal(36)
    observed = seen + term.residual(theta)[0] + NOISE * rng.standard_normal(seen.shape)
    exp = exp.assign(hand_image=exp["hand_image"].copy(data=observed[None]))
    problem = Problem.of(body, [Observed(exp, noise={"images": NOISE})])
    sd = np.where(free, np.concatenate([SD, np.ones(len(theta) - 36)]), np.inf)
    other = ByDifferences(body, q, observed)
    ours, theirs = [], []
    for _ in range(rounds):
        seconds, fit = timed(lambda: maximum_a_posteriori(problem.terms, free=free, sd=sd, robust=False))
        ours.append(seconds)
        seconds, found = timed(other.fit)
        theirs.append(seconds)
        print(f"ours {ours[-1]:.3f} s, differences {theirs[-1]:.3f} s", flush=True)
    apart = float(np.abs((fit.theta[free] - found) / SD).max())  # type: ignore[attr-defined]
    infant = bk.load_embodiment("infant")
    poses = infant.felt_robot.sample(20000, seed=2)[:, [infant.felt_robot.joint_index(name) for name in infant.joints]]
    poses = poses[infant.visible(poses)][:500].numpy()
    image = infant.hand_image(poses).numpy() + 2e-4 * rng.standard_normal((len(poses), 2))
    rec = bk.recording(q=poses, hand_image=image, joints=list(infant.joints), order="scattered", unit="m")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scoring, _ = timed(lambda: bk.score({name.lower(): name for name in ESTIMATORS}, None, rec))
    result = {
        "ours_s": ours, "differences_s": theirs, "ratio": float(np.median(theirs) / np.median(ours)),
        "largest_difference_over_prior": apart, "score_s": scoring, "poses": len(poses), "estimators": len(ESTIMATORS),
    }  # fmt: skip
    (HERE / "calibration.json").write_text(json.dumps(result, indent=1) + "\n")
    (HERE / "calibration.md").write_text(
        "| what | processor time [s] |\n| --- | --- |\n"
        f"| 36 numbers on 1,000 poses, ours | {np.median(ours):.3f} |\n"
        f"| the same, finite differences over a Pinocchio loop | {np.median(theirs):.2f} |\n"
        f"| ratio (same answer to {apart:.1e} of the prior) | {result['ratio']:.0f} |\n"
        f"| {len(ESTIMATORS)} estimators scored without a truth on {len(poses)} poses | {scoring:.1f} |\n"
    )
    print((HERE / "calibration.md").read_text())


if __name__ == "__main__":
    main()
