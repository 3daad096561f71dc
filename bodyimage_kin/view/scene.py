"""What a viewer shows at a moment, computed apart from any window: places, images, ellipses, colours and words."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int

from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._shown import Shown
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, InvalidGeometry, UnknownName
from bodyimage_kin.estimators import Learned, Uncertain
from bodyimage_kin.figures.visuals import Surface, link_surfaces
from bodyimage_kin.recordings.schema import align, first_taxel, is_scattered
from bodyimage_kin.robot.geometry import LinkGeometry
from bodyimage_kin.view._followers import Followed, Followers
from bodyimage_kin.view._followers import Teacher as Teacher
from bodyimage_kin.view._sight import Sight

__all__ = ["Moment", "Scene", "Teacher"]

Points: TypeAlias = Float[np.ndarray, "_ 3"]
_BALL = 0.15
"""Share of the picture's size that the true Jacobian's longer half axis takes."""


@dataclass(frozen=True, eq=False)
class Moment(Shown):
    """What is to be seen at one posture, or at one sample of a recording.

    Attributes:
        q: (p,) felt posture [rad or m].
        links: Link -> (4, 4) where it is in the root; those that have something to see.
        camera: (4, 4) where the camera is in the root.
        hand: (3,) the hand in the root [m]; the simulator's truth where there is one.
        image: (3,) its image on the picture, in the camera's axes [m]; NaN for none.
        estimate: (3,) the estimated image there; NaN for none.
        estimated_hand: (3,) where a hand at the true one's depth would have the estimated image, in the root [m].
        true_ellipse: (points, 3) how unit motions of the joints move the image, about it; in the camera's axes.
        learned_ellipse: The same of the learned Jacobian, to the same scale.
        doubt: (points, 3) two standard deviations about the estimate, of the displacement since the last reset.
        path: (points, 3) the estimate since the last reset, in the camera's axes.
        map: (taxels, 3) the tactile map learned so far, in the camera's axes; none without touches.
        touched: Taxels that report a touch.
        values: (taxels,) what the skin is coloured by, 0 to 1; NaN stays grey.
        says: What there is to read, a line each.
    """

    q: Float[np.ndarray, "p"]
    links: Mapping[str, Float[np.ndarray, "4 4"]]
    camera: Float[np.ndarray, "4 4"]
    hand: Float[np.ndarray, "3"]
    image: Float[np.ndarray, "3"]
    estimate: Float[np.ndarray, "3"]
    estimated_hand: Float[np.ndarray, "3"]
    true_ellipse: Points
    learned_ellipse: Points
    doubt: Points
    path: Points
    map: Points
    touched: tuple[int, ...]
    values: Float[np.ndarray, "taxels"]
    says: tuple[str, ...]


@dataclass(eq=False)
class Scene(Shown):
    """A body with recordings of it and with those who learned from one.

    Attributes:
        body: The embodiment.
        recordings: Name -> recording of this body; its joints are put in the body's order.
        estimators: Name -> estimator, which learns when it is first looked at, or what was learned.
        learn_from: What estimators learn from; None: the recording that is looked at.
        scores: Name -> one value a taxel, to colour the skin by.
        ghosts: (count, p) postures to be shown as well, such as the next ones to go to.
        mesh_folder: Where meshes may be read; None: beside the URDF.

    Raises:
        InvalidRecording: A recording of another body.
        InvalidConfig: Scores that are not one a taxel, or ghosts of other joints.
    """

    body: Embodiment
    recordings: Mapping[str, xr.Dataset] = field(default_factory=dict)
    estimators: Mapping[str, Teacher] = field(default_factory=dict)
    learn_from: xr.Dataset | None = None
    scores: Mapping[str, ArrayLike] = field(default_factory=dict)
    ghosts: ArrayLike | None = None
    mesh_folder: str | os.PathLike[str] | None = None

    def __post_init__(self) -> None:
        self.notes: list[str] = []
        self.recordings = {name: align(one, self.body) for name, one in self.recordings.items()}
        if self.learn_from is not None:
            self.learn_from = align(self.learn_from, self.body)
        count = self.body.skin.count if self.body.skin is not None else 0
        self.scores = {
            name: as_float_array(values, f"scores['{name}']").ravel() for name, values in self.scores.items()
        }
        for name, values in self.scores.items():
            if len(values) != count:
                raise InvalidConfig(f"scores['{name}'] has {len(values)} values; give one for each of {count} taxels")
        self.surfaces = self._surfaces()
        self._kinematics = kinematics(self.body.robot)
        self._moved = [name for name in self.surfaces if self._is_moved(name)]
        rest = [name for name in self.surfaces if name not in self._moved]
        self._still = {name: self._kinematics.pose(self.body.home, name).numpy() for name in rest}
        self._followers = Followers(self.body, self.recordings, self.estimators, self.learn_from)
        home = self.body.felt_home
        self.sight = Sight(self.body.camera, float(self.body.hand_in_camera(home)[2]), self._images())
        self.q_ghosts = np.empty((0, self.body.p))
        if self.ghosts is not None:
            self.q_ghosts = as_float_array(self.ghosts, "ghosts", ndim=2)
            if self.q_ghosts.shape[1] != self.body.p:
                raise InvalidConfig(f"ghosts have {self.q_ghosts.shape[1]} joints; this body feels {self.body.p}")

    # What there is ---------------------------------------------------------------------------------------------------

    @property
    def colourings(self) -> tuple[str, ...]:
        """What the skin can be coloured by."""
        return ("touches", *self.scores)

    def trials(self, recording: str) -> int:
        """Number of trials of a recording.

        Raises:
            UnknownName: No such recording.
        """
        return int(self._recording(recording).sizes["trial"])

    def samples(self, recording: str, trial: int = 0) -> int:
        """Number of samples of a trial, without padding.

        Raises:
            UnknownName: No such recording.
        """
        felt = np.isfinite(self._recording(recording)["q"].values[trial]).all(-1)
        return int(np.flatnonzero(felt)[-1]) + 1 if felt.any() else 0

    def stops(self, recording: str, trial: int = 0) -> Int[np.ndarray, "stops"]:
        """The samples that a slider goes through: all of a stream, of scattered postures those with a touch, if any.

        Raises:
            UnknownName: No such recording.
        """
        of, every = self._recording(recording), np.arange(self.samples(recording, trial))
        felt = np.isfinite(of["q"].values[trial, : len(every)]).all(-1)
        if is_scattered(of) and "touched" in of:
            touching = first_taxel(of)[trial, : len(every)] >= 0
            if touching.any():
                return every[touching & felt]
        return every[felt]

    # Moments ---------------------------------------------------------------------------------------------------------

    def posture(self, q: ArrayLike, estimator: str = "", colouring: str = "touches", recording: str = "") -> Moment:
        """What is to be seen at a posture, of no recording.

        Args:
            q: (p,) felt joints [rad or m].
            estimator: Whose learned Jacobian is shown; empty: none.
            colouring: One of :attr:`colourings`.
            recording: What an estimator learns from that was given nothing else; empty: the first.

        Raises:
            UnknownName: No such estimator, recording or colouring.
            InvalidPosture: No posture of this body.
        """
        felt = np.asarray(as_float_array(q, "q", shapes=((self.body.p,),)))
        kept = None
        if estimator:
            kept = self._followers.learned(recording or next(iter(self.recordings), ""), estimator)
        return self._moment(felt, kept, colouring)

    def moment(
        self, recording: str, index: int, estimator: str = "", colouring: str = "touches", trial: int = 0
    ) -> Moment:
        """What is to be seen at a sample of a recording.

        Args:
            recording: Its name.
            index: The sample's number.
            estimator: Whose estimate, learned Jacobian and map are shown; empty: none.
            colouring: One of :attr:`colourings`.
            trial: The trial's number.

        Raises:
            UnknownName: No such recording, estimator or colouring.
        """
        of = self._recording(recording)
        index = int(np.clip(index, 0, max(self.samples(recording, trial) - 1, 0)))
        kept = self._followers.followed(recording, estimator, trial) if estimator else None
        felt = of["q"].values[trial, index]
        return self._moment(felt, kept, colouring, (of, trial, index))

    def ghost_links(self) -> list[dict[str, Float[np.ndarray, "4 4"]]]:
        """Where the felt links are in each of the postures that are shown as well."""
        return [{name: self._poses(q)[name] for name in self._moved} for q in self.q_ghosts]

    # Inner -----------------------------------------------------------------------------------------------------------

    def _moment(
        self,
        q: Float[np.ndarray, "p"],
        kept: Followed | None,
        colouring: str,
        at: tuple[xr.Dataset, int, int] | None = None,
    ) -> Moment:
        body, nothing = self.body, np.empty((0, 3))
        felt = torch.from_numpy(np.array(q, dtype=np.float64))
        camera = body.kinematics.pose(felt, body.camera.link).numpy() @ body.camera.link_T_camera.numpy()
        hand = self._hand(felt, at)
        depth = float((hand - camera[:3, 3]) @ camera[:3, 2])
        image = self._image(felt, at)
        says = [f"{name} {value:.3f}" for name, value in zip(body.joints, q, strict=True)] if at is None else []
        estimate, doubt, path, grown = np.full(body.m, np.nan), nothing, nothing, nothing
        if at is not None:
            says += _words(*at)
        if kept is not None and kept.problem:
            says.append(kept.problem)
        if kept is not None and at is not None and len(kept.estimate):
            index = at[2]
            estimate, begin = kept.estimate[index], int(kept.begins[index])
            path = self.sight.place(kept.estimate[begin : index + 1]) if begin >= 0 else nothing
            doubt = self._doubt(kept, at, estimate, begin)
            if kept.maps is not None and kept.steps is not None:
                snapshot = int(np.searchsorted(kept.steps, index, side="right")) - 1
                grown = self.sight.place(kept.maps[max(snapshot, 0)].reshape(-1, kept.maps.shape[-1]))
            off = float(np.linalg.norm(estimate - image))
            if np.isfinite(off):
                says.append(f"estimate off by {_size(off, body.camera.model.unit)}")
        true_ellipse, learned_ellipse = self._ellipses(felt, image, kept)
        on_picture = self.sight.place(np.stack([image, estimate]))
        far = self.sight.place(estimate[None], depth)[0] if depth > 0 else np.full(3, np.nan)
        return Moment(
            q=np.array(q),
            links=self._poses(felt.numpy()),
            camera=camera,
            hand=hand,
            image=on_picture[0],
            estimate=on_picture[1],
            estimated_hand=camera[:3, :3] @ far + camera[:3, 3],
            true_ellipse=true_ellipse,
            learned_ellipse=learned_ellipse,
            doubt=doubt,
            path=path,
            map=grown,
            touched=_touched(at),
            values=self._values(colouring, at),
            says=tuple(says),
        )

    def _poses(self, q: Float[np.ndarray, "p"]) -> dict[str, Float[np.ndarray, "4 4"]]:
        whole = self.body.full_posture(torch.from_numpy(np.array(q)))
        return self._still | {name: self._kinematics.pose(whole, name).numpy() for name in self._moved}

    def _is_moved(self, link: str) -> bool:
        """Whether felt joints move a link, those that follow them included."""
        robot = self.body.robot
        return any(
            joint.kind != "fixed" and robot.source_of(joint.name)[0] in self.body.joints for joint in robot.path(link)
        )

    def _hand(self, felt: torch.Tensor, at: tuple[xr.Dataset, int, int] | None) -> Float[np.ndarray, "3"]:
        there = _recorded(at, "true_hand_position")
        if there is not None:
            return there
        return self.body.hand_position(felt, self._offset(at)).numpy()

    def _image(self, felt: torch.Tensor, at: tuple[xr.Dataset, int, int] | None) -> Float[np.ndarray, "m"]:
        """The true image of the hand where there is a truth, else what was seen, else that of the posture."""
        there = _recorded(at, "true_hand_image", "hand_image")
        if there is not None:
            return there
        return self.body.hand_image(felt, self._offset(at), on_invisible="nan").numpy()

    @staticmethod
    def _offset(at: tuple[xr.Dataset, int, int] | None) -> Float[np.ndarray, "3"] | None:
        if at is None or "hand_offset" not in at[0]:
            return None
        offset = at[0]["hand_offset"].values[at[1], at[2]]
        return np.array(offset) if np.isfinite(offset).all() else None

    def _ellipses(
        self, felt: torch.Tensor, image: Float[np.ndarray, "m"], kept: Followed | None
    ) -> tuple[Points, Points]:
        nothing = np.empty((0, 3))
        true = self.body.hand_image_jacobian(felt, on_invisible="nan").numpy()
        if not self.sight.shows or not (np.isfinite(true).all() and np.isfinite(image).all()):
            return nothing, nothing
        scale = _BALL * self.sight.size / max(float(np.linalg.svd(true[:2], compute_uv=False)[0]), 1e-12)
        learned = nothing
        if kept is not None and isinstance(kept.learned, Learned):
            found = kept.learned.jacobian(felt).detach().numpy()
            if np.isfinite(found).all():
                learned = self.sight.ellipse(image, scale * found)
        return self.sight.ellipse(image, scale * true), learned

    def _doubt(
        self, kept: Followed, at: tuple[xr.Dataset, int, int], estimate: Float[np.ndarray, "m"], begin: int
    ) -> Points:
        if not isinstance(kept.learned, Uncertain) or begin < 0 or not np.isfinite(estimate).all():
            return np.empty((0, 3))
        start, here = (torch.from_numpy(at[0]["q"].values[at[1], index]) for index in (begin, at[2]))
        try:
            covariance = kept.learned.displacement_covariance(start, here - start).detach().numpy()
            root = np.linalg.cholesky(covariance + 1e-18 * np.trace(covariance) * np.eye(len(covariance)))
        except (BodyImageKinError, np.linalg.LinAlgError):
            return np.empty((0, 3))
        return self.sight.ellipse(estimate, 2 * root)

    def _values(self, colouring: str, at: tuple[xr.Dataset, int, int] | None) -> Float[np.ndarray, "taxels"]:
        if colouring not in self.colourings:
            raise UnknownName("colouring", colouring, self.colourings)
        if self.body.skin is None:
            return np.empty(0)
        if colouring in self.scores:
            values = self.scores[colouring]
            low, high = min(0.0, float(np.nanmin(values))), float(np.nanmax(values))
            return np.asarray((values - low) / max(high - low, 1e-12))
        count = self.body.skin.count
        if at is None or "touched" not in at[0]:
            return np.full(count, np.nan)
        so_far = at[0]["touched"].values[at[1], : at[2] + 1]
        counts = np.bincount(so_far[(so_far >= 0) & (so_far < count)], minlength=count).astype(float)
        return np.where(counts > 0, np.sqrt(counts / max(counts.max(), 1.0)), np.nan)

    def _recording(self, name: str) -> xr.Dataset:
        if name not in self.recordings:
            raise UnknownName("recording", name, self.recordings)
        return self.recordings[name]

    def _images(self) -> Float[np.ndarray, "count m"]:
        """Images that are to fit on the picture: those recorded, and of some postures near home."""
        found = [
            one[name].values.reshape(-1, self.body.m)
            for one in self.recordings.values()
            for name in ("hand_image", "true_hand_image")
            if name in one
        ]
        home = self.body.felt_home[None]
        return np.concatenate([*found, self.body.hand_image(home, on_invisible="nan").numpy()])

    def _surfaces(self) -> dict[str, Surface]:
        """What the links look like; rods where the meshes are missing."""
        robot = self.body.robot
        try:
            return link_surfaces(robot, mesh_folder=self.mesh_folder)
        except InvalidGeometry as problem:
            self.notes.append(f"rods instead of the robot: {problem}")
            bare = dataclasses.replace(robot, geometry={name: LinkGeometry() for name in robot.link_names})
            return link_surfaces(bare)


def _touched(at: tuple[xr.Dataset, int, int] | None) -> tuple[int, ...]:
    if at is None or "touched" not in at[0]:
        return ()
    return tuple(int(taxel) for taxel in at[0]["touched"].values[at[1], at[2]] if taxel >= 0)


def _words(of: xr.Dataset, trial: int, index: int) -> list[str]:
    if is_scattered(of) or "time" not in of.coords:
        said = [f"posture {index}"]
    else:
        unit = of["time"].attrs.get("units", "s")
        said = [f"sample {index}, {float(of['time'].values[index]):.2f} {unit}"]
    touched: Sequence[int] = _touched((of, trial, index))
    said.append(f"touches {', '.join(map(str, touched))}" if touched else "touches nothing")
    if "at_reference" in of and bool(of["at_reference"].values[trial, index]):
        said.append("rests at the reference: the estimate begins anew")
    return said


def _size(value: float, unit: str) -> str:
    return f"{1e3 * value:.1f} mm" if unit == "m" else f"{value:.1f} {unit}"


def _recorded(at: tuple[xr.Dataset, int, int] | None, *names: str) -> Float[np.ndarray, "values"] | None:
    """The first of these variables that a recording has, all finite, at a trial and time; None: there is none."""
    if at is None:
        return None
    recording, trial, time = at
    for name in names:
        if name in recording and np.isfinite(there := recording[name].values[trial, time]).all():
            return np.asarray(there)
    return None
