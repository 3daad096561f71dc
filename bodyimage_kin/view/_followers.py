"""Those who learn, and where each of them thinks that the hand was: computed once for each recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import BodyImage, integrate
from bodyimage_kin.errors import BodyImageKinError, UnknownName
from bodyimage_kin.estimators import Estimator, HasDisplacement
from bodyimage_kin.recordings import experience
from bodyimage_kin.recordings.schema import is_scattered

Teacher: TypeAlias = "Estimator | HasDisplacement"
_SNAPSHOTS = 60
"""Of a map that grows."""


@dataclass(eq=False)
class Followed:
    """What one estimator makes of one recording.

    Attributes:
        learned: What it learned; None where it could not.
        estimate: (time, m) the estimated hand image; of no recording none.
        begins: (time,) the sample that the sum of each sample began at, -1 before the first.
        maps: (snapshots, rows, columns, m) the tactile map as it grows; None without touches.
        steps: (snapshots,) samples that each map had learned from.
        problem: What went wrong, in a line.
    """

    learned: HasDisplacement | None
    estimate: Float[np.ndarray, "time m"]
    begins: Int[np.ndarray, "time"]
    maps: Float[np.ndarray, "snapshots rows columns m"] | None = None
    steps: Int[np.ndarray, "snapshots"] | None = None
    problem: str = ""


class Followers:
    """Estimators that learn from recordings of one body, and follow its hand."""

    def __init__(
        self,
        body: Embodiment,
        recordings: Mapping[str, xr.Dataset],
        estimators: Mapping[str, Teacher],
        learn_from: xr.Dataset | None,
    ) -> None:
        """Nothing is computed before it is asked for.

        Args:
            body: Whose recordings they are.
            recordings: Name -> recording, its joints in the body's order.
            estimators: Name -> estimator, or what was learned.
            learn_from: What estimators learn from; None: the recording that they follow.
        """
        self.body, self.recordings, self.estimators, self.learn_from = body, recordings, estimators, learn_from
        self._followed: dict[tuple[str, str, int], Followed] = {}
        self._taught: dict[tuple[str, str], Followed] = {}

    def learned(self, recording: str, estimator: str) -> Followed:
        """What an estimator learned, for a posture of no recording.

        Args:
            recording: What it learns from, where nothing else was given.
            estimator: Its name.

        Raises:
            UnknownName: No such estimator.
        """
        if estimator not in self.estimators:
            raise UnknownName("estimator", estimator, self.estimators)
        source = "" if self.learn_from is not None else recording
        if (source, estimator) not in self._taught:
            nothing = np.empty((0, self.body.m)), np.empty(0, dtype=np.int64)
            try:
                found = Followed(self._learn(recording, estimator), *nothing)
            except (BodyImageKinError, ValueError, RuntimeError) as problem:
                found = Followed(None, *nothing, problem=f"{estimator}: {problem}")
            self._taught[source, estimator] = found
        return self._taught[source, estimator]

    def followed(self, recording: str, estimator: str, trial: int) -> Followed:
        """What an estimator makes of a trial of a recording.

        Args:
            recording: Its name.
            estimator: Its name.
            trial: Number of the trial.

        Raises:
            UnknownName: No such estimator.
        """
        key = recording, estimator, trial
        if key not in self._followed:
            taught = self.learned(recording, estimator)
            self._followed[key] = self._follow(taught, self.recordings[recording], estimator, trial)
        return self._followed[key]

    # Inner -----------------------------------------------------------------------------------------------------------

    def _learn(self, recording: str, estimator: str) -> HasDisplacement:
        one = self.estimators[estimator]
        if not isinstance(one, Estimator):
            return one
        seen = self.learn_from if self.learn_from is not None else self.recordings.get(recording)
        if seen is None:
            raise UnknownName("recording", recording, self.recordings)
        return one.fit(experience(seen), seed=0)

    def _follow(self, taught: Followed, of: xr.Dataset, estimator: str, trial: int) -> Followed:
        if taught.learned is None:
            return taught
        try:
            found = Followed(taught.learned, *self._path(of, taught.learned, trial))
            self._grow(found, of, trial)
        except (BodyImageKinError, ValueError, RuntimeError) as problem:
            found = Followed(None, taught.estimate, taught.begins, problem=f"{estimator}: {problem}")
        return found

    def _path(
        self, of: xr.Dataset, learned: HasDisplacement, trial: int
    ) -> tuple[Float[np.ndarray, "time m"], Int[np.ndarray, "time"]]:
        """The integrated hand image of a trial, and where the sum of each sample began."""
        one = of.isel(trial=[trial])
        resets = one["at_reference"].values[0] if "at_reference" in one and "reference_image" in one else None
        first = torch.from_numpy(one["q"].values[0, 0])
        begin = self.body.hand_image(first, on_invisible="nan").numpy()
        known = resets is not None and resets.any()
        how = {} if known else {"reset": "none", "initial": begin}
        path = "star" if is_scattered(of) else "time"
        found = integrate(experience(self._with_axes(one)), learned, path=path, **how)  # type: ignore[arg-type]
        times = np.arange(one.sizes["time"])
        starts = resets if known and resets is not None else times == 0
        since = np.maximum.accumulate(np.where(starts, times, -1)) if path == "time" else times
        return found.values[0], since

    def _with_axes(self, one: xr.Dataset) -> xr.Dataset:
        if "axis" in one.dims:
            return one
        unseen = np.full((*one["q"].shape[:2], self.body.m), np.nan)
        return one.assign(hand_image=(("trial", "time", "axis"), unseen, {"units": self.body.camera.model.unit}))

    def _grow(self, found: Followed, of: xr.Dataset, trial: int) -> None:
        """Lets the tactile map learn from the estimate, where there are touches and a skin."""
        skin = self.body.skin
        if skin is None or "touched" not in of or not (of["touched"].values[trial] >= 0).any():
            return
        one = of.isel(trial=[trial])
        steps = np.unique(np.linspace(0, one.sizes["time"], _SNAPSHOTS).astype(int))
        try:
            learned = BodyImage.learn(
                experience(self._with_axes(one)), found.estimate[None], skin=skin, snapshots=steps.tolist()
            )
        except BodyImageKinError as problem:
            found.problem = f"no map: {problem}"
            return
        found.maps, found.steps = learned.history["tactile_maps"], learned.history["steps"]
