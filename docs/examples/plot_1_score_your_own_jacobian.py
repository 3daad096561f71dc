"""
Score your own Jacobian
=======================

You held the hand 3 cm in front of the nose, moved one joint after the other a little, and saw how far the hand moved in
the image. That gave you one matrix, and you use it everywhere. How wrong is it on the face, where the hand cannot be
seen, and why?
"""

import matplotlib.pyplot as plt
import numpy as np

import bodyimage_kin as bk

body = bk.load_embodiment("infant")
posture = body.touch_postures([body.skin.landmarks["nose"]], distance=0.03)[0].numpy()
steps = 0.05 * np.eye(body.p)  # [rad], one joint at a time
seen = body.hand_image(posture + steps).numpy() - body.hand_image(posture).numpy()
seen += np.random.default_rng(0).normal(0.0, 0.0002, seen.shape)  # an eye that is 0.2 mm off
measured = np.linalg.solve(steps, seen).T


def my_jacobian(q):
    """Yours, whatever it is: from one posture, (p,) [rad], to a Jacobian, (2, p) [m/rad]."""
    return measured


# %%
# Ask it at every posture in which the hand touches the face, and hold the answers against the analytic truth. Joints
# count as much as they move in touching: ``excitation`` takes this metric from a recording of touches.

q = body.touch_postures(range(body.skin.count))  # (441, p), one posture a taxel
true = body.hand_image_jacobian(q)
mine = np.stack([my_jacobian(one) for one in q.numpy()])

touch = bk.simulate(body, bk.motions.RandomTouch(duration=60.0), seed=0)
excitation = bk.metrics.excitation(steps, touch)
parts = bk.metrics.attribute(true, mine, excitation.motion_metric, excitation)
for name in ("scale", "mean_excited", "mean_unexcited", "variation", "total"):
    print(f"{name:15s} {getattr(parts, name):.3f} of the squared relative error")

# %%
# Left, the error at each taxel. Then what is left of it once the matrix is scaled by the one number that helps most.
# Right, the squared error over the whole face as the sum of its parts.

figure, (*faces, bars) = plt.subplots(1, 3, figsize=(8.5, 3.3), layout="constrained")
jacobians = {"as measured": mine, f"scaled by its best factor, {parts.best_scale:.2f}": parts.best_scale * mine}
for axes, (title, jacobian) in zip(faces, jacobians.items(), strict=True):
    errors = bk.metrics.jacobian_errors(true, jacobian, metric=excitation.motion_metric)
    bk.figures.face(body, errors.relative_error, axes, label="relative error", limits=(0, 0.8))
    axes.set_title(title)
names = ("scale", "mean_excited", "mean_unexcited", "variation")
bk.figures.attribution({"mine": {name: getattr(parts, name) for name in names}}, bars)
bars.set_title("why")
bk.figures.legend(figure, below=True)
plt.show()

# %%
# Most of it is *scale*: the matrix was measured farther from the eye than it is used, so what it foresees is too small,
# and no single eye could know by how much. What one factor cannot mend is mostly *variation*: it differs from taxel
# to taxel, and no constant matrix can follow.
