"""
Open your own table
===================

A table of joint angles and pixels, and nothing else: no URDF, no calibrated camera. How well can each learner foresee
motion that it did not see, and is it the learner that limits it, or the noise?
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import bodyimage_kin as bk

# Stands for your file: 400 postures of three joints, in no order, and a marker seen to 0.5 px.
rng = np.random.default_rng(0)
q = rng.uniform(-0.8, 0.8, (400, 3))
away = 1.2 + 0.3 * np.cos(q[:, 0]) * np.cos(q[:, 1])
u = 320 + 400 * np.sin(q[:, 0] + 0.3 * q[:, 2]) / away + rng.normal(0, 0.5, 400)
v = 240 + 400 * np.sin(q[:, 1] - 0.2 * q[:, 2]) / away + rng.normal(0, 0.5, 400)
file = Path(tempfile.mkdtemp()) / "table.csv"
columns = {"shoulder": q[:, 0], "elbow": q[:, 1], "wrist": q[:, 2]}
pd.DataFrame({name: np.degrees(of) for name, of in columns.items()} | {"u": u, "v": v}).to_csv(file, index=False)

# %%
# Which columns are what, and in which unit; mistakes in a table are told with row and column.

recording = bk.read_recording(
    file,
    {"q": ["shoulder", "elbow", "wrist"], "hand_image": ["u", "v"]},
    units={"q": "deg", "hand_image": "px"},
    order="scattered",
)
bk.figures.recording(recording)

# %%
# Fifths of the rows are hidden in turn. What cannot be foreseen, however good the learner, is the noise of two images.

exp = bk.experience(recording)
noise = bk.metrics.stated_noise(2, image=0.5)
specs = (bk.estimators.LeastSquares(), bk.estimators.Polynomial(), bk.estimators.GaussianProcess())
errors = {}
for spec in specs:
    folds = bk.metrics.hold_out_folds(exp, folds=5)
    predicted = [bk.metrics.predicted_pairs(spec.fit(one.seen), one.hidden) for one in folds]
    found = [bk.metrics.pair_error(one, fold.hidden.dr, noise) for one, fold in zip(predicted, folds, strict=True)]
    errors[type(spec).__name__] = [one.error for one in found]
    print(f"{type(spec).__name__:16s} {np.median(errors[type(spec).__name__]):.1f} px")

# %%
# A dot is a fold.

figure, axes = plt.subplots(figsize=(5.0, 2.2), layout="constrained")
for row, of in enumerate(errors.values()):
    axes.plot(of, [row] * len(of), "o", alpha=0.7)
axes.axvline(found[0].floor, color="0.5", linestyle="--", linewidth=0.8, label="noise alone")
axes.set(yticks=range(len(errors)), xlabel="error of foreseen motion [px]", xlim=(0, None))
axes.set_ylim(-0.5, len(errors) - 0.5)
axes.set_yticklabels([bk.figures.label(name) for name in errors])
axes.legend()
plt.show()
