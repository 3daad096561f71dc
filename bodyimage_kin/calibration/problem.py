"""From a body and what was observed to a problem of least squares: whose parameters, told by which evidence."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import xarray as xr
from jaxtyping import Float, Int

from bodyimage_kin import _checks
from bodyimage_kin._arrays import ArrayLike, as_float_array
from bodyimage_kin._shown import Shown
from bodyimage_kin.body import Camera, Embodiment
from bodyimage_kin.body.clusters import touched_place
from bodyimage_kin.errors import InvalidConfig, InvalidRecording
from bodyimage_kin.estimators.evidence import Images, Planes, Points, Touches
from bodyimage_kin.estimators.intrinsics import Intrinsics
from bodyimage_kin.estimators.map_fit import Term
from bodyimage_kin.estimators.parametric import Mount, Parameter, ParametricBody

__all__ = ["KINDS", "Observed", "Problem"]

KINDS = ("images", "points", "touches", "plane")
"""Kinds of evidence in a recording: ``hand_image``, ``hand_position``, ``touched``, and postures on one plane."""


@dataclass(frozen=True, eq=False)
class Observed(Shown):
    """An experience, and what is meant by what was observed in it.

    Attributes:
        experience: Postures, with images, a tracker's points, or touches.
        use: Kinds of evidence that count; None: all that are there but ``"plane"``, which must be asked for.
        camera: What took the images; None: the body's own.
        point: Name of the point that was observed; recordings that observe the same point of the hand share its name.
        offset: (3,) that point in the hand's link [m]; None: the hand's centre, or the recording's ``hand_offset``.
        noise: Standard deviation of each kind of evidence [its unit], by kind; estimated where it is not given.
    """

    experience: xr.Dataset
    use: Sequence[str] | None = None
    camera: Camera | None = None
    point: str = "hand"
    offset: ArrayLike | None = None
    noise: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        for kind in self.use or ():
            _checks.choice("use", kind, KINDS)
        for kind, value in (self.noise or {}).items():
            _checks.choice("noise", kind, KINDS)
            _checks.number(f"noise[{kind!r}]", value, above=0.0)


@dataclass(frozen=True, eq=False)
class _Rows:
    """One kind of evidence in one recording.

    Attributes:
        kind: Which.
        observed: Where it is from.
        samples: (rows,) indices of its samples, trials one after the other.
        q: (rows, p) felt postures.
        values: (rows, m) what was observed.
        offset: (rows, 3) the observed point in the hand's link [m].
    """

    kind: str
    observed: Observed
    samples: Int[np.ndarray, "rows"]
    q: Float[np.ndarray, "rows p"]
    values: Float[np.ndarray, "rows m"]
    offset: Float[np.ndarray, "rows 3"]


@dataclass(frozen=True, eq=False)
class Problem(Shown):
    """A body with parameters, and all evidence of them.

    Attributes:
        body: As it is thought to be.
        parametric: The same, with parameters.
        terms: The evidence, one term for each kind in each recording.
        samples: Of each term, the samples (trials one after the other) that its rows are.
        blocks: Of each term, the block that each of its rows belongs to.
        intrinsics: Of each camera, by the name of its mount.
        held: Parameters that are never free: turns of a point of the hand that is one point alone.
        left_out: What was observed and tells nothing, in words.
        observed: What all of it is from.
    """

    body: Embodiment
    parametric: ParametricBody
    terms: tuple[Term, ...]
    samples: tuple[Int[np.ndarray, "_"], ...]
    blocks: tuple[Int[np.ndarray, "_"], ...]
    intrinsics: Mapping[str, Intrinsics]
    held: frozenset[int]
    left_out: tuple[str, ...]
    observed: tuple[Observed, ...]

    @classmethod
    def of(cls, body: Embodiment, observed: Sequence[Observed], folds: int = 5) -> Problem:
        """The problem of a body and what was observed of it.

        Raises:
            InvalidRecording: Nothing in it tells of the body.
            InvalidConfig: A kind of evidence that the recording does not have.
        """
        left_out: list[str] = []
        rows = [one for each in observed for one in _evidence(body, each, left_out)]
        if not rows:
            raise InvalidRecording(
                "nothing observed tells of the body: give images, a tracker's points, or touches of its skin"
            )
        mounts, intrinsics = _mounts(body, rows)
        others = [parameter for one in intrinsics.values() for parameter in one.parameters]
        planes = [one for one in rows if one.kind == "plane"]
        for number in range(len(planes)):
            words = (("tilt, first", "rad"), ("tilt, second", "rad"), ("distance", "m"))
            others += [Parameter(f"plane {number + 1}: {word}", "plane", unit) for word, unit in words]
        parametric = ParametricBody(body.felt_robot, body.joints, mounts.values(), others)
        first_plane = len(parametric.parameters) - 3 * len(planes)
        terms: list[Term] = []
        for one in rows:
            plane = first_plane + 3 * planes.index(one) if one.kind == "plane" else -1
            terms.append(_term(body, parametric, one, intrinsics, plane))
        return cls(
            body,
            parametric,
            tuple(terms),
            tuple(one.samples for one in rows),
            tuple(_blocks(one, folds) for one in rows),
            intrinsics,
            frozenset(_pointless(parametric, rows)),
            tuple(left_out),
            tuple(observed),
        )

    def subset(self, kept: Sequence[np.ndarray]) -> tuple[Term, ...]:
        """The terms with some of their rows, those that are left without any excluded.

        Args:
            kept: Of each term, which rows.
        """
        return tuple(term.taken(rows) for term, rows in zip(self.terms, kept, strict=True) if rows.any())


# Inner ---------------------------------------------------------------------------------------------------------------


def _evidence(body: Embodiment, observed: Observed, left_out: list[str]) -> Iterable[_Rows]:
    exp = observed.experience
    q = _flat(exp, "q")
    order = [str(name) for name in exp["joint"].values] if "joint" in exp.coords else list(body.joints)
    if sorted(order) != sorted(body.joints):
        raise InvalidConfig(
            f"the recording is of joints {', '.join(order)}, embodiment '{body.name}' feels {', '.join(body.joints)}; "
            "give the body it was recorded with"
        )
    q = q[:, [order.index(name) for name in body.joints]]
    offset = np.broadcast_to(_offset(body, observed), (len(q), 3))
    if "hand_offset" in exp and observed.offset is None:
        offset = _flat(exp, "hand_offset")
    felt = np.isfinite(q).all(1) & np.isfinite(offset).all(1)
    there = {"images": "hand_image", "points": "hand_position", "touches": "touched", "plane": "q"}
    kinds = [kind for kind in KINDS[:3] if there[kind] in exp] if observed.use is None else list(observed.use)
    if "touches" in kinds and body.skin is None and observed.use is None:
        kinds.remove("touches")
    for kind in kinds:
        if there[kind] not in exp:
            raise InvalidConfig(f"use: the recording has no {there[kind]}, which '{kind}' are made of")
        if kind == "touches":
            values = _touched(body, exp, left_out)
        elif kind == "plane":
            values = np.zeros((len(q), 1))
        else:
            values = _flat(exp, there[kind])
        good = felt & (np.isfinite(values).any(1) if kind == "images" else np.isfinite(values).all(1))
        if good.any():
            yield _Rows(kind, observed, np.flatnonzero(good), q[good], values[good], offset[good])


def _flat(exp: xr.Dataset, name: str) -> Float[np.ndarray, "rows columns"]:
    values = np.asarray(exp[name].values, dtype=np.float64)
    return values.reshape(-1, values.shape[-1])


def _offset(body: Embodiment, observed: Observed) -> Float[np.ndarray, "3"]:
    if observed.offset is None:
        return body.hand.offset.numpy()
    return as_float_array(observed.offset, "offset", shapes=((3,),), error=InvalidConfig)


def _touched(body: Embodiment, exp: xr.Dataset, left_out: list[str]) -> Float[np.ndarray, "rows 3"]:
    """Where the hand's centre was when these taxels felt it, in the skin's link [m]; NaN where that is not known."""
    skin = body.skin
    if skin is None:
        raise InvalidConfig(f"embodiment '{body.name}' has no skin, so its touches tell nothing")
    touched = np.asarray(exp["touched"].values, dtype=np.int64)
    touched = touched.reshape(-1, touched.shape[-1])
    if touched.size and touched.max() >= skin.count:
        raise InvalidRecording(f"the recording touches taxel {touched.max()}, the skin has {skin.count}")
    places = np.full((len(touched), 3), np.nan)
    ambiguous = 0
    for row, active in enumerate(touched):
        members = touched_place(skin.link_positions, active)
        if members is None:
            ambiguous += bool((active >= 0).any())
            continue
        places[row] = skin.link_positions[members].mean(0) + body.hand.radius * skin.link_normals[members].mean(0)
    if ambiguous:
        left_out.append(f"{ambiguous} of {len(touched)} touches, whose active taxels lie in two places as large")
    return places


def _mounts(body: Embodiment, rows: Sequence[_Rows]) -> tuple[dict[str, Mount], dict[str, Intrinsics]]:
    mounts: dict[str, Mount] = {}
    intrinsics: dict[str, Intrinsics] = {}
    cameras: list[Camera] = []
    for one in rows:
        point = one.observed.point
        mounts.setdefault(point, Mount(point, "hand", body.hand.link, np.eye(4)))
        if one.kind == "images":
            camera = one.observed.camera or body.camera
            if camera not in cameras:
                cameras.append(camera)
            name = _camera_name(cameras.index(camera))
            mounts.setdefault(name, Mount(name, "camera", camera.link, camera.link_T_camera.numpy()))
            intrinsics.setdefault(name, Intrinsics.of(name, camera.model))
        elif one.kind == "points":
            mounts.setdefault("tracker", Mount("tracker", "tracker", body.robot.root, _tracker(body, one)))
        elif one.kind == "touches" and body.skin is not None:
            mounts.setdefault("skin", Mount("skin", "skin", body.skin.link, np.eye(4)))
    return mounts, intrinsics


def _pointless(parametric: ParametricBody, rows: Sequence[_Rows]) -> Iterable[int]:
    """Turns about a single point do what shifts do already."""
    for name in {one.observed.point for one in rows}:
        offsets = np.concatenate([one.offset for one in rows if one.observed.point == name])
        if np.ptp(offsets, axis=0).max() == 0.0:
            yield from (
                index
                for index, one in enumerate(parametric.parameters)
                if one.unit == "rad" and one.name.startswith(f"{name}: turn")
            )


def _camera_name(index: int) -> str:
    return "camera" if index == 0 else f"camera {index + 1}"


def _tracker(body: Embodiment, rows: _Rows) -> Float[np.ndarray, "4 4"]:
    """Where the tracker stands in the root, by the nominal body: the best rigid fit (Kabsch 1976)."""
    with torch.no_grad():
        pose = body.kinematics.pose(torch.from_numpy(rows.q), body.hand.link).numpy()
    places = pose[:, :3, 3] + (pose[:, :3, :3] @ rows.offset[..., None])[..., 0]
    there, here = rows.values.mean(0), places.mean(0)
    U, _, Vt = np.linalg.svd((rows.values - there).T @ (places - here))
    turn = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn, here - turn @ there
    return found


def _term(
    body: Embodiment, parametric: ParametricBody, rows: _Rows, intrinsics: Mapping[str, Intrinsics], plane: int
) -> Term:
    observed = rows.observed
    sigma = None if observed.noise is None else observed.noise.get(rows.kind)
    shared = (rows.kind, parametric, rows.q, rows.offset, sigma, observed.point)
    if rows.kind == "images":
        camera = observed.camera or body.camera
        name = next(
            mount.name
            for mount in parametric.mounts
            if mount.group == "camera"
            and mount.link == camera.link
            and np.array_equal(mount.link_T_mount, camera.link_T_camera.numpy())
        )
        first = parametric.parameters.index(intrinsics[name].parameters[0]) if intrinsics[name].parameters else -1
        return Images(*shared, name, intrinsics[name], first, rows.values)
    if rows.kind == "points":
        return Points(*shared, "tracker", rows.values)
    if rows.kind == "touches":
        return Touches(*shared, "skin", rows.values)
    level = Planes(*shared, plane, np.array([0.0, 0.0, 1.0]), 0.0)
    places, _ = level.point_seen(np.zeros(len(parametric.parameters)))
    centre = places.mean(0)
    normal = np.linalg.svd(places - centre)[2][-1]
    return replace(level, normal=normal, distance=float(normal @ centre))


def _blocks(rows: _Rows, folds: int) -> Int[np.ndarray, "rows"]:
    """The recording's own blocks, else contiguous parts of equal numbers."""
    exp = rows.observed.experience
    if "block" in exp:
        given = np.asarray(exp["block"].values).ravel()[rows.samples]
        return np.unique(given, return_inverse=True)[1]
    return np.arange(len(rows.q)) * folds // max(len(rows.q), 1)
