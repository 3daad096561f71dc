"""
Compare estimators
==================

One arm, one recording, six ways to learn a Jacobian from it. Which of them hold where the hand was seen, and which on
the face, where it never was?
"""

import matplotlib.pyplot as plt

import bodyimage_kin as bk

body = bk.load_embodiment("infant")
noise = bk.Noise(torque=0.1, encoder=0.001, image=0.0002)  # the paper's [N m], and of the sensors [rad], [m]
recording = bk.simulate(body, bk.motions.Circle(), seed=0, noise=noise)
estimators = {
    "least_squares": bk.estimators.LeastSquares(),
    "paper_mlp": bk.estimators.PaperMLP(),
    "gaussian_process": bk.estimators.GaussianProcess(),
    "trig_ridge": bk.estimators.TrigRidge(),
    "rational_trig": bk.estimators.RationalTrig(),
    # Knows the structure, and measures that are off.
    "self_calibration": bk.estimators.Misinformed(bk.estimators.SelfCalibration(body)),
}

# %%
# Learners get the experience, which is the recording without its truth. They are scored along the circle itself, at
# every taxel 3 cm in front of the face, and touching it.

seen = bk.experience(recording)
learned = {name: estimator.fit(seen, seed=0) for name, estimator in estimators.items()}
probes = {
    "on_circle": bk.probes.Training(),
    "in_front": bk.probes.Face(distance=0.03),
    "on_face": bk.probes.Face(),
}
touch = bk.simulate(body, bk.motions.RandomTouch(duration=60.0), seed=0)
excitation = bk.metrics.excitation(recording, touch)  # of the felt motions

# %%
# The squared relative error is a sum of four parts, none of them negative. A Jacobian of zeros has 1.

parts = ("scale", "mean_excited", "mean_unexcited", "variation")
figure, panels = plt.subplots(1, 3, sharey=True, figsize=(8.5, 3.3), layout="constrained")
for axes, (place, probe) in zip(panels, probes.items(), strict=True):
    q = probe.postures(body, recording)
    true = body.hand_image_jacobian(q)
    bars = {}
    for name in learned:
        found = bk.metrics.attribute(true, learned[name].jacobian(q), excitation.motion_metric, excitation)
        print(f"{place:10s} {name:17s} relative error {found.total**0.5:.3f}")
        bars[name] = {part: getattr(found, part) for part in parts}
    bk.figures.attribution(bars, axes)
    axes.set(title=bk.figures.label(place), xlim=(0, 0.4))
bk.figures.legend(figure)
plt.show()

# %%
# At the distance where the hand was seen, all errors are small. On the face every one is larger, and most of what sets
# them apart is one scale, that of depth: a constant matrix (least squares) and a network of motion alone (the paper's)
# have no word for it. Models of a hand before a pinhole eye (rational trigonometric) or of the whole arm
# (self-calibration) find it in how the image changed where the hand was seen.
