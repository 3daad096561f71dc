"""
Add an estimator
================

You have an idea how to learn a Jacobian. Does it beat least squares and the paper's network, and where? The idea here:
a Jacobian that changes linearly with posture. An estimator is anything with ``fit(experience, seed)``; what it returns
is anything with ``jacobian(q)`` and ``displacement(q, dq)``, from tensors to tensors.
"""

import tempfile
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import torch

import bodyimage_kin as bk


@dataclass(frozen=True)
class LinearInPosture:
    """The estimator: ridge regression of dr on dq and all products of dq and q."""

    penalty: float = 1e-4

    def fit(self, exp, seed=0):
        q, image = exp.q.values[0], exp.hand_image.values[0]  # (time, p), (time, m)
        dq, dr, centre, p = np.diff(q, axis=0), np.diff(image, axis=0), q.mean(0), q.shape[1]
        products = dq[:, :, None] * (q[:-1] - centre)[:, None, :]
        X = np.hstack([dq, products.reshape(len(dq), -1)])
        ridge = self.penalty * (dq**2).sum() / p * np.eye(X.shape[1])
        J, change = np.split(np.linalg.solve(X.T @ X + ridge, X.T @ dr).T, [p], axis=1)
        return ChangingJacobian(*map(torch.from_numpy, (centre, J, change.reshape(-1, p, p))))


@dataclass(frozen=True)
class ChangingJacobian:
    """What it learned: J(q) = J + sum over k of (q_k - centre_k) change_k."""

    centre: torch.Tensor  # (p,)
    J: torch.Tensor  # (m, p)
    change: torch.Tensor  # (m, p, p)

    def jacobian(self, q):
        return self.J + torch.einsum("mik,...k->...mi", self.change, q - self.centre)

    def displacement(self, q, dq):
        return (self.jacobian(q) @ dq[..., None])[..., 0]


# %%
# A study takes it beside the library's own. Worker processes must find its class, so keep it in a module and give an
# object of it, or its place, ``"package.module:Class"``. Here its place is this script, and one process does the work.

ours = {"least_squares": bk.estimators.LeastSquares(), "paper_mlp": "PaperMLP"}
study = bk.Study(
    embodiments={"infant": "infant"},
    recordings={"noisy": bk.study.Simulation(bk.motions.Circle(), noise=bk.Noise(torque=0.1))},
    estimators=ours | {"yours": f"{__name__}:LinearInPosture"},
    probes=["training", "in_front", "on_face"],
    seeds=4,
)
with tempfile.TemporaryDirectory() as store:
    errors = study.run(store, "in-process").relative_error_use.squeeze()
print(errors.mean("seed").to_pandas().round(3))

# %%
looks = bk.figures.looks(ours) | {"yours": {"color": "black", "marker": "^"}}
probes = [bk.figures.label(probe) for probe in errors.probe.values]
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name, look in looks.items():
    lines = axes.plot(probes, errors.sel(estimator=name).T, **look)
    lines[0].set_label(bk.figures.label(name))
axes.set(ylabel="relative error, one line a recording", ylim=(0, None))
axes.legend()
plt.show()

# %%
# Where the hand was seen, the idea halves the error. On the face it gains next to nothing over a constant matrix.
