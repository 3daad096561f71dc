"""
Learn a map of the face
=======================

A robot saw its hand on a circle and learned a Jacobian. Now the hand touches the face, where no eye sees it. Which
place in the image belongs to each taxel, and how wrong does the map become when the Jacobian is?
"""

import matplotlib.pyplot as plt
import numpy as np

import bodyimage_kin as bk

body = bk.load_embodiment("infant")
seen = bk.simulate(body, bk.motions.Circle(), seed=0, dynamics=False)
touch = bk.simulate(body, bk.motions.RandomTouch(duration=400.0), seed=0, dynamics=False)
bk.figures.recording(touch)

# %%
# Learned motion is summed from one rest at the reference taxel to the next. The map learns from that sum whenever a
# taxel is touched; handing it the true image instead is the best that its rule can do.

felt = bk.experience(touch)
learned = {
    "analytic": bk.estimators.Analytic(body),
    "least_squares": bk.estimators.LeastSquares(),
    "rational_trig": bk.estimators.RationalTrig(),
}
hands = {name: bk.integrate(felt, spec.fit(bk.experience(seen))) for name, spec in learned.items()}
hands["direct"] = touch.true_hand_image
maps = {name: bk.BodyImage.learn(felt, hand, seed=0).tactile_map for name, hand in hands.items()}

# %%
# Each dot is a taxel where the map has it; behind, where it truly is.

q = body.touch_postures(range(body.skin.count))
true = body.hand_image(q).numpy().reshape(maps["direct"].shape)
figure, panels = plt.subplots(2, 2, figsize=(7.0, 7.2), layout="constrained", sharex=True, sharey=True)
for axes, (name, places) in zip(panels.flat, maps.items(), strict=True):
    bk.figures.tactile_map(places, axes, true=true, landmarks=body.skin.landmarks)
    axes.set_title(bk.figures.label(name))
    away = 1e3 * np.sqrt(((places - maps["direct"]) ** 2).sum(-1).mean())
    wrong = bk.metrics.topological_error(places)
    print(f"{bk.figures.label(name):25s} {away:5.1f} mm from the map of direct sight, {wrong} taxels out of order")
bk.figures.legend(figure, below=True)
plt.show()

# %%
# All maps are in order: order says next to nothing of the Jacobian. Their sizes and places do.
