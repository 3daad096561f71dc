"""
Read a study with xarray
========================

Who learns better than least squares, and does it depend on the noise that shakes the arm? A study answers with a grid:
here two recordings, three estimators and five seeds, scored at every probe. Its result is an ``xarray.Dataset``.
"""

import tempfile

import matplotlib.pyplot as plt

import bodyimage_kin as bk
from bodyimage_kin.study import compare

circle = bk.motions.Circle()
study = bk.Study(
    embodiments={"infant": "infant"},
    recordings={
        "quiet": circle,
        "noisy": bk.study.Simulation(circle, noise=bk.Noise(torque=0.1)),
    },
    use=bk.motions.RandomTouch(duration=20.0),  # where the metric is taken from
    estimators={
        "least_squares": "LeastSquares",
        "paper_mlp": "PaperMLP",
        "trig_ridge": bk.estimators.TrigRidge(),
    },
    probes=["training", "in_front", "on_face"],
    seeds=5,
)
with tempfile.TemporaryDirectory() as store:  # in earnest, one that stays
    results = study.run(store, "in-process")  # without this, one process for each processor
print(*results.sizes)

# %%
# Select by name, reduce by name: errors on the face, and how much of the squared error is depth.

infant = results.sel(embodiment="infant")
print(infant.relative_error_use.sel(probe="on_face").mean("seed").to_pandas().round(3))
print(infant.attribution.sel(probe="on_face", part="scale").mean("seed").to_pandas().round(3))

# %%
# Estimators learned from the same recordings, so they are compared in pairs: an estimator's error over that of least
# squares, as a geometric mean with its 95 % interval. Five recordings are for orientation; thirty would do for print.

ratios = compare(results, "relative_error_use", baseline="least_squares")
on_face = ratios[["ratio", "lower", "upper"]].sel(probe="on_face", drop=True)
print(on_face.to_dataframe().round(3))

# %%
figure, panels = plt.subplots(1, 2, sharey=True, figsize=(8.5, 3.6), layout="constrained")
looks = {
    "paper_mlp": {"color": "#c2407e", "marker": "o", "label": "paper's network"},
    "trig_ridge": {"color": "#117733", "marker": "s", "label": "trigonometric ridge"},
}
for axes, recording in zip(panels, ratios.recording.values, strict=True):
    for shift, (name, look) in zip((-0.08, 0.08), looks.items(), strict=True):
        one = ratios.sel(recording=recording, estimator=name)
        places = [index + shift for index in range(one.sizes["probe"])]
        reach = [one.ratio - one.lower, one.upper - one.ratio]
        axes.errorbar(places, one.ratio, reach, **look, linestyle="", capsize=3)
    axes.axhline(1.0, color="0.4", linewidth=0.8, linestyle="--", label="least squares")
    axes.set_xticks(range(one.sizes["probe"]), map(bk.figures.label, one.probe.values))
    axes.set(title=f"{recording} recordings", xlim=(-0.5, 2.5))
panels[0].set(ylabel="error over that of least squares", ylim=(0, 1.2))
figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()

# %%
# Below the dashed line is better than least squares. Trigonometric ridge is, everywhere; the paper's network is after
# quiet circles. After noisy ones it is slightly worse on the circle itself, and better on the face.
