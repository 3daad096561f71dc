"""
Use another robot
=================

An arm of six joints, given by its table of Denavit and Hartenberg, and a camera on a post: where is its learned
Jacobian right, and who extrapolates?
"""

import matplotlib.pyplot as plt
import numpy as np

import bodyimage_kin as bk

# a [m], d [m], alpha [rad], offset [rad]: the published measures of a UR5, turned so that zero is a bent arm.
rows = [
    [0.0, 0.0892, np.pi / 2, 0.0],
    [-0.425, 0.0, 0.0, -1.9],
    [-0.3922, 0.0, 0.0, 1.6],
    [0.0, 0.1092, np.pi / 2, 0.3],
    [0.0, 0.0947, -np.pi / 2, 0.0],
    [0.0, 0.0823, 0.0, 0.0],
]
robot = bk.Robot.from_dh(rows, limits=[(-1.2, 1.2)] * 6, name="arm")
print(robot, robot.notes)

# %%
# The camera looks at the hand from a metre away. A body without a skin needs no more than this.

hand = bk.kinematics(robot).pose(np.zeros(6), robot.link_names[-1])[:3, 3].numpy()
forward = np.array([-0.8, 0.0, -0.6])  # where it looks; then right and down as the image has them
right = np.array([0.0, 1.0, 0.0])
mount = np.eye(4)
mount[:3] = np.stack([right, np.cross(forward, right), forward, hand - forward], axis=1)
body = bk.Embodiment.build(
    robot,
    joints=robot.joint_names[:5],  # the last one turns the hand on the spot
    hand=bk.Hand(robot.link_names[-1]),
    camera=bk.Camera(robot.root, mount, bk.Pinhole(800.0, 800.0, 320.0, 240.0, size=(640, 480))),
)
print(body)

# %%
# It watches its hand on circles of 10 cm, begun from ten postures, to a third of a pixel.

circle = bk.motions.Circle(radius=0.1, distance=1.0, turns=1.0, rest_spread=0.5)
seen = bk.simulate(body, circle, seed=0, trials=10, dynamics=False, noise=bk.Noise(image=0.3))
specs = {
    "analytic": bk.estimators.Analytic(body),
    "least_squares": bk.estimators.LeastSquares(),
    "polynomial": bk.estimators.Polynomial(),
    "rational_trig": bk.estimators.RationalTrig(),
}
probes = [bk.probes.Training(), bk.probes.JointSpace(count=200)]
fits = {name: spec.fit(bk.experience(seen)) for name, spec in specs.items()}
scores = {name: bk.score(one, body, seen, probes=probes).relative_error_use for name, one in fits.items()}

# %%
# Left, the arm; right, the error where it watched and over all of its joint space.

figure, (left, bars) = plt.subplots(1, 2, figsize=(8.0, 3.4), layout="constrained", width_ratios=(1, 1.6))
bk.figures.robot(body, ax=left).set_title("the arm at home")
names = [str(name) for name in scores["analytic"].probe.values]
for index, (name, errors) in enumerate(scores.items()):
    bars.bar(np.arange(len(names)) + 0.2 * index, errors.values, 0.18, label=bk.figures.label(name))
    print(f"{bk.figures.label(name):22s}", dict(zip(names, errors.values.round(3).tolist(), strict=True)))
bars.axhline(1.0, color="0.5", linestyle="--", linewidth=0.8)
bars.set(xticks=np.arange(len(names)) + 0.3, ylabel="relative error of the Jacobian", yscale="symlog")
bars.set_xticklabels([bk.figures.label(name) for name in names])
bars.legend()
plt.show()
