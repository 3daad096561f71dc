"""What a score is, and what it is computed from: one recording and what was learned from it, each thing computed once.

A score of one's own is a :class:`Score` at the top of a module; a study takes it, or ``"package.module:NAME"``::

    def _largest(context):
        return max(abs(one).max() for one in context.learned_jacobians.values())

    LARGEST = bk.study.Score("largest_entry", (), "largest entry of the learned Jacobian", _largest, units="m/rad")
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float

from bodyimage_kin import metrics
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body_image import BodyImage, PostureSOM, PostureToImage, integrate
from bodyimage_kin.errors import BodyImageKinError, InvalidRecording, UnknownName
from bodyimage_kin.estimators import HasDisplacement
from bodyimage_kin.metrics import probes
from bodyimage_kin.recordings import experience
from bodyimage_kin.study import maps
from bodyimage_kin.study.answers import checked, jacobians
from bodyimage_kin.study.grid import Row, Simulation
from bodyimage_kin.study.specs import plain_name
from bodyimage_kin.study.store import padded

__all__ = ["FOLDS", "IMAGE", "Context", "Fact", "LeftOut", "Score", "image_unit"]

_NEEDED = ("body", "skin", "truth", "learned", "estimator", "use", "true_use", "tour", "maps")


FOLDS = 5
"""How many parts of a recording are hidden in turn at most: groups of its blocks."""
IMAGE = "image"
"""Units of a score that is in those of the hand image: metres on a virtual screen, pixels of a lens."""


def image_unit(seen: xr.Dataset | None) -> str:
    """What the images of a recording are in; metres where nothing says it."""
    return "m" if seen is None or "hand_image" not in seen else str(seen["hand_image"].attrs.get("units", "m"))


class LeftOut(BodyImageKinError):
    """A score that this recording, or what was learned from it, cannot give; the others are none the worse for it."""


@dataclass(eq=False)
class Context:
    """One recording and, for scores, what was learned from it: all that a score or a fact is a function of.

    Attributes:
        body: The embodiment; None: it is not known.
        seen: The recording that is learned from, with the truth where there is one.
        use: The recording of touches; None: there is none, and the motion of ``seen`` counts.
        tour: The recording along which displacements are compared; None: there is none.
        learned: The learned Jacobian; None: facts of the recording, or direct sight.
        probes: Name -> probe.
        row: How what is learned is used.
        estimator: What learned it.
        simulation: How the recordings came about; None: they were given.
        seed: Of the fit.
        seconds: Processor time that the fit took [s].
        map_seeds: Of the posture map, then of each of the first maps; none: no map is learned.
        map_settings: Of :meth:`bodyimage_kin.BodyImage.learn`, for all rows.
        cut: A direction counts as excited from this on.
        of: Whose motion counts: ``"felt"`` or ``"true"``.
        known: Facts of the recording that are known already, by name.
        shared: What one score computed that others take up, by a name of their own.
    """

    body: Embodiment | None
    seen: xr.Dataset
    use: xr.Dataset | None = None
    tour: xr.Dataset | None = None
    learned: Any = None
    probes: Mapping[str, Any] = field(default_factory=dict)
    row: Row = field(default_factory=Row)
    estimator: Any = None
    simulation: Simulation | None = None
    seed: int = 0
    seconds: float = float("nan")
    map_seeds: Sequence[int] = ()
    map_settings: Mapping[str, Any] = field(default_factory=dict)
    cut: float = 0.1
    of: Literal["felt", "true"] = "felt"
    known: Mapping[str, Any] = field(default_factory=dict)
    shared: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def has(self) -> frozenset[str]:
        """What is there, of what scores may need.

        ``body, skin, truth, learned, estimator, use, true_use, tour, maps``.
        """
        skin = self.body is not None and self.body.skin is not None
        there = {
            "body": self.body is not None,
            "skin": skin,
            "truth": "true_q" in self.seen,
            "learned": self.learned is not None,
            "estimator": self.estimator is not None,
            "use": self.use is not None,
            "true_use": self.use is not None and "true_hand_image" in self.use,
            "tour": self.tour is not None and "true_hand_image" in self.tour,
            "maps": skin and self.use is not None and len(self.map_seeds) > 1,
        }
        return frozenset(name for name, is_there in there.items() if is_there)

    # Recordings -------------------------------------------------------------------------------------------------------

    @cached_property
    def experience(self) -> xr.Dataset:
        """Of what is learned from: without the truth."""
        return experience(self.seen)

    @cached_property
    def felt_use(self) -> xr.Dataset:
        """Experience of the touches."""
        assert self.use is not None
        return experience(self.use)

    @cached_property
    def motion_metric(self) -> Float[np.ndarray, "p p"]:
        """Of the motion of use [rad^2]; without one, of the motion that is learned from."""
        return self.excitation.motion_metric if self.excitation else metrics.motion_metric(self.seen, self.of)

    @cached_property
    def excitation(self) -> metrics.Excitation | None:
        """Of the motion of use by what is learned from; None without a use."""
        return None if self.use is None else metrics.excitation(self.seen, self.use, self.of, self.cut)

    # Held out ---------------------------------------------------------------------------------------------------------

    @cached_property
    def folds(self) -> list[metrics.HeldOut]:
        """What is learned from with one part hidden, each in turn: whole blocks where it has any.

        Raises:
            LeftOut: No images, or a single block.
        """
        try:
            return metrics.hold_out_folds(self.experience, FOLDS)
        except InvalidRecording as problem:
            raise LeftOut(str(problem)) from None

    @cached_property
    def learned_by_fold(self) -> list[Any]:
        """What the estimator learns without each fold, with the seed that it had for all of the recording.

        Raises:
            LeftOut: It cannot learn from what remains beside one.
        """
        found = []
        for number, part in enumerate(self.folds):
            try:
                found.append(self.estimator.fit(part.seen.copy(deep=True), self.seed))
            except BodyImageKinError as problem:
                raise LeftOut(f"without fold {number} of {len(self.folds)}: {problem}") from None
        return found

    # At probes --------------------------------------------------------------------------------------------------------

    @cached_property
    def postures(self) -> dict[str, Float[torch.Tensor, "postures p"]]:
        """Probe -> postures; without those of a skin that the body does not have."""
        assert self.body is not None
        kept = {
            name: one for name, one in self.probes.items() if "skin" in self.has or not isinstance(one, probes.Face)
        }
        return {name: probes.probe_postures(one, self.body, self.seen) for name, one in kept.items()}

    @cached_property
    def true_jacobians(self) -> dict[str, Float[np.ndarray, "postures m p"]]:
        """Probe -> true Jacobians of the hand image."""
        assert self.body is not None
        with torch.no_grad():
            return {
                name: jacobians("true jacobian", self.body.hand_image_jacobian, q, self.body.m)
                for name, q in self.postures.items()
            }

    @cached_property
    def learned_jacobians(self) -> dict[str, Float[np.ndarray, "postures m p"]]:
        """Probe -> learned Jacobians.

        Raises:
            WrongResult: Of another shape, or not finite.
        """
        assert self.body is not None
        return {
            name: jacobians(f"jacobian at probe '{name}'", self.learned.jacobian, q, self.body.m)
            for name, q in self.postures.items()
        }

    def by_probe(self, score: Callable[..., Any], *arguments: Any) -> Float[np.ndarray, "probe ..."]:
        """A function of true and learned Jacobians, and of further arguments, at each probe; NaN where one has none."""
        rows: list[Any] = []
        for name in self.probes:
            there = name in self.true_jacobians
            rows.append(score(self.true_jacobians[name], self.learned_jacobians[name], *arguments) if there else None)
        return padded(rows)

    @cached_property
    def attributions(self) -> dict[str, metrics.Attribution]:
        """Probe -> the squared error in the motion's metric, attributed."""
        return {
            name: metrics.attribute(J, self.learned_jacobians[name], self.motion_metric, self.excitation)
            for name, J in self.true_jacobians.items()
        }

    # Paths and maps ---------------------------------------------------------------------------------------------------

    @cached_property
    def tour_path(self) -> Float[np.ndarray, "trial time m"]:
        """The integrated tour, from its true beginning.

        Raises:
            WrongResult: Not finite.
        """
        assert self.tour is not None
        begin = self.tour["true_hand_image"].values[:, 0]
        return self._integrated("tour", self.learned, experience(self.tour), reset="none", initial=begin).values

    @cached_property
    def hand(self) -> xr.DataArray:
        """The hand image that is estimated on touches; of direct sight, the true one.

        Raises:
            WrongResult: Not finite.
        """
        assert self.use is not None
        return self.use["true_hand_image"] if self.learned is None else self.hand_by(self.learned)

    def hand_by(self, learned: HasDisplacement) -> xr.DataArray:
        """The hand image on touches as any learned Jacobian estimates it, by the row's settings.

        Args:
            learned: What foretells displacements.

        Raises:
            WrongResult: Not finite.
        """
        reset = self.row.reset
        settings: dict[str, Any] = {}
        if reset == "posture_map":
            settings["posture_map"] = self._posture_map
        if reset == "none":
            settings["initial"] = self.felt_use["reference_image"].values
        # A diagnostic alone is handed the truth.
        felt = self.use if reset == "true" else self.felt_use
        assert felt is not None
        return self._integrated("touching", learned, felt, reset=reset, **settings)

    @cached_property
    def _posture_map(self) -> PostureToImage:
        return PostureToImage.fit(self.experience)

    @cached_property
    def posture_som(self) -> PostureSOM:
        """Representative postures of the posture map, the same for every row."""
        if "posture_units" in self.known and "posture_grid" not in self.row.maps:
            return PostureSOM(self.known["posture_units"], self.known["posture_scale"])
        grid = self._map_settings.get("posture_grid", maps.POSTURE_GRID)
        return maps.posture_som(self.felt_use, self.map_seeds[0], grid)

    @cached_property
    def maps(self) -> list[BodyImage]:
        """What touching teaches with this hand estimate, one a first map."""
        return [self.learn_map(self.hand, seed) for seed in self.map_seeds[1:]]

    @cached_property
    def direct_maps(
        self,
    ) -> tuple[Float[np.ndarray, "maps *taxels m"], Float[np.ndarray, "maps rows_ columns_ m"]]:
        """Tactile and posture map of direct sight, one a first map."""
        names, count = ("direct_map", "direct_posture_map"), len(self.map_seeds) - 1
        if not self.row.maps and all(len(self.known.get(name, ())) >= count for name in names):
            return self.known[names[0]][:count], self.known[names[1]][:count]
        assert self.use is not None
        learned = [self.learn_map(self.use["true_hand_image"], seed) for seed in self.map_seeds[1:]]
        return np.stack([one.tactile_map for one in learned]), np.stack([one.posture_map for one in learned])

    def learn_map(self, hand: xr.DataArray, seed: int, **settings: Any) -> BodyImage:
        """The maps that these hand images lead to.

        Args:
            hand: (trial, time, m) hand images, in the camera's unit.
            seed: Of the first maps.
            settings: Of :meth:`bodyimage_kin.BodyImage.learn` that differ from the row's.
        """
        assert self.body is not None
        given = {"skin": self.body.require_skin(), "snapshots": (), **self._map_settings}
        given |= {"image_range": maps.seen_range(self.experience), "posture_som": self.posture_som, **settings}
        return BodyImage.learn(self.felt_use, hand, seed=seed, **given)

    @property
    def _map_settings(self) -> dict[str, Any]:
        return {**self.map_settings, **self.row.maps}

    def _integrated(self, what: str, learned: HasDisplacement, felt: xr.Dataset, **settings: Any) -> xr.DataArray:
        """The integrated hand image, once it is known to be finite wherever it can be."""
        method, substeps = self.row.method, self.row.substeps
        with torch.no_grad(), np.errstate(all="ignore"):
            path = integrate(felt, learned, method=method, substeps=substeps, **settings)
        # Scores of a path leave out what is not finite: one that explodes would seem to be a good one.
        there = np.isfinite(felt["q"].values).all(-1)
        if settings["reset"] != "none":
            there &= np.maximum.accumulate(felt["at_reference"].values.astype(bool) & there, axis=1)
        checked(f"the integrated {what}", path.values[there], path.values[there].shape)
        return path

    # Truth ------------------------------------------------------------------------------------------------------------

    def oracle_difference(self, most: int) -> float:
        """Largest difference of the body's Jacobian from Pinocchio's, over probes [image unit/rad]."""
        assert self.body is not None
        if self.body.kinematics.name == "pinocchio":
            return 0.0
        oracle = dataclasses.replace(self.body, kinematics=kinematics(self.body.felt_robot, "pinocchio"))
        q = torch.cat(list(self.postures.values()))
        q = q[:: max(1, len(q) // most)]
        with torch.no_grad():
            return float((self.body.hand_image_jacobian(q) - oracle.hand_image_jacobian(q)).abs().max())


@dataclass(frozen=True)
class Score:
    """One score of a learned Jacobian.

    Attributes:
        name: Its name in results.
        dims: Beside embodiment, recording, estimator and seed.
        long_name: What it is.
        of: Numbers (or text) of these dimensions, from the context; raises :class:`LeftOut` where it finds that
            there are none.
        units: ``"1"`` where it has none; ``IMAGE`` where it is that of the hand image.
        needs: What must be there (:attr:`Context.has`); where it is not, the score is left out.
        labels: Dimension -> names along it; of ``probe`` and ``axis`` they are known.
        source: Where its formula is.
        ratio: Whether it is positive and compared by ratios.
        optional: Whether it is computed only when a study asks for it by name, for it takes its time.
    """

    name: str
    dims: tuple[str, ...]
    long_name: str
    of: Callable[[Context], Any]
    units: str = "1"
    needs: tuple[str, ...] = ("learned",)
    labels: Mapping[str, tuple[str, ...]] | None = None
    source: str = ""
    ratio: bool = True
    optional: bool = False

    def __post_init__(self) -> None:
        plain_name("score", self.name)
        for need in self.needs:
            if need not in _NEEDED:
                raise UnknownName(f"need of score '{self.name}'", need, _NEEDED)

    def attributes(self, image_unit: str) -> dict[str, str]:
        """As attributes of a variable.

        Args:
            image_unit: What hand images are in.
        """
        found = {"long_name": self.long_name, "units": image_unit if self.units == IMAGE else self.units}
        return found | ({"source": f"bodyimage_kin.metrics.{self.source}"} if self.source else {})


@dataclass(frozen=True)
class Fact(Score):
    """One fact of a recording, whatever is learned from it: a score without an estimator."""

    needs: tuple[str, ...] = ()
