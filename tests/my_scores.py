"""Scores, facts, a motion and estimators of a user's own; workers import them by name."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

import bodyimage_kin as bk
from bodyimage_kin.estimators import Estimator, LeastSquares

LARGEST = bk.study.Score(
    "largest_entry",
    (),
    "largest entry of the learned Jacobian at the probes",
    lambda context: max(abs(one).max() for one in context.learned_jacobians.values()),
    "m/rad",
)
PATH = bk.study.Score("tour_image", ("time", "axis"), "the integrated tour", lambda context: context.tour_path[0], "m")
SNAPSHOTS = bk.study.Score(
    "snapshots",
    ("first_map", "snapshot"),
    "topological error of each map on its way",
    lambda context: np.array(
        [[bk.metrics.topological_error(map) for map in one.history["tactile_maps"]] for one in context.maps]
    ),
    needs=("maps",),
)
WORDS = bk.study.Score(
    "words", ("word",), "what it is", lambda context: np.array(["a", "bcé"]), labels={"word": ("x", "y")}
)
STEPS = bk.study.Fact("felt_steps", (), "felt steps of the training", lambda context: context.seen.sizes["time"] - 1)
BROKEN = bk.study.Score("broken", ("probe",), "of fewer dimensions than it says", lambda context: 1.0)
NO_SCORE = 3


@dataclass(frozen=True)
class Wave(bk.motions.Motion):
    """A small motion of one's own."""

    height: float = 0.02
    in_view: ClassVar[bool] = True

    def path(self, body, rng, sampling):
        t = np.arange(0.0, 6.0, sampling)
        return bk.motions.Path(
            body.touch_centres([220], 0.04)[0].numpy() + self.height * np.stack([0 * t, np.sin(t), np.cos(t)], axis=1)
        )


class NoMotion:
    """Has the method of a motion, and is none."""

    built = 0

    def __init__(self):
        NoMotion.built += 1

    def path(self, body, rng, sampling):
        raise AssertionError


@dataclass(frozen=True)
class Careless(Estimator):
    """Does what it should not, and learns all the same."""

    way: str = "prints"

    def fit(self, exp, seed=0):
        learned = LeastSquares().fit(exp, seed)
        if self.way == "prints":
            print("said", seed)
            os.write(2, b"past Python\n")
        if self.way == "closes":
            sys.stdout.close()
            os.chdir("/")
            torch.set_default_dtype(torch.float32)
        if self.way == "changes":
            for name in exp.variables:
                if exp[name].dtype.kind == "f" and exp[name].values.flags.writeable:
                    exp[name].values[...] = 0.0
        return learned
