"""
Design a recording
==================

What a robot never did, it cannot learn. Which direction did it never move in, and would another recording have shown
it?

The infant draws a circle in view. Before anything is learned, the motion of its joints can be held against the motion
that the Jacobian is wanted for: touching the face.
"""

import matplotlib.pyplot as plt

import bodyimage_kin as bk

body = bk.load_embodiment("infant")
designs = {
    "the paper's circle": (bk.motions.Circle(), None),
    "ten turns, not three": (bk.motions.Circle(turns=10.0), None),
    "radius 8 cm, not 5": (bk.motions.Circle(radius=0.08), None),
    "torque noise": (bk.motions.Circle(), bk.Noise(torque=0.1)),
}
touch = bk.simulate(body, bk.motions.RandomTouch(duration=60.0), seed=0)

# %%
# An eigenvalue is the mean squared motion along one direction, the circle's over that of touching. A direction of less
# than a tenth does not count as excited. Printed with the weakest: the squared relative error of least squares on the
# face, and two parts of it.

excitations = {}
q = body.touch_postures(range(body.skin.count))
true = body.hand_image_jacobian(q)
for name, (motion, noise) in designs.items():
    circle = bk.simulate(body, motion, seed=0, noise=noise)
    found = excitations[name] = bk.metrics.excitation(circle, touch)
    learned = bk.estimators.LeastSquares().fit(bk.experience(circle))
    parts = bk.metrics.attribute(true, learned.jacobian(q), found.motion_metric, found)
    print(f"{name:20s} weakest {found.eigenvalues[-1]:.3f};", end=" ")
    print(f"error {parts.total:.2f}, unexcited {parts.mean_unexcited:.2f}, scale {parts.scale:.2f}")

# %%
# Left, the eigenvalues of each design. Right, the weakest direction of the paper's circle as joint motion, which is
# ``motion_metric @ eigenvector``: how far touching moves along it in a step of 0.1 s, one standard deviation to either
# side.

figure, (spectra, direction) = plt.subplots(1, 2, figsize=(8.5, 3.8), layout="constrained")
number = range(1, 1 + body.p)
looks = {"o-": "black", "x--": "#56b4e9", "s-.": "#e69f00", "^:": "#009e73"}
for (name, found), (look, color) in zip(excitations.items(), looks.items(), strict=True):
    spectra.semilogy(number, found.eigenvalues, look, color=color, label=name)
spectra.axhline(0.1, color="0.5", linewidth=0.8)
spectra.text(1, 0.09, "excited above this line", va="top", color="0.3")
spectra.set(xlabel="direction, most excited first", ylabel="motion, circle over touching")
spectra.set_xticks(number)
spectra.legend()
weakest = excitations["the paper's circle"]
joints = [joint.removeprefix("left_").replace("_", " ") for joint in body.joints]
motion = weakest.motion_metric @ weakest.eigenvectors[:, -1]
direction.barh(joints, 1000 * motion, color="0.8", edgecolor="black")
direction.axvline(0.0, color="black", linewidth=0.8)
direction.set(title="what the paper's circle hardly does", xlabel="motion in one step [mrad]")
direction.invert_yaxis()
plt.show()

# %%
# The paper's circle leaves out one direction, a motion of shoulder and elbow together. More turns are more of the same;
# a larger circle just reaches it; torque noise shakes the arm along every one. Then nothing of the error is unexcited,
# and still it hardly falls: the face is nearer than the circle, which no motion tells a constant matrix.
