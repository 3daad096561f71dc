"""What cannot work with a body, or will be missed, said before anything is computed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from bodyimage_kin import _checks
from bodyimage_kin.body.cameras import Camera, Tracker
from bodyimage_kin.body.embodiment import Embodiment, Frame
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import BodyImageKinError, InvalidConfig, ManyMistakes
from bodyimage_kin.robot.geometry import Mesh
from bodyimage_kin.robot.meshes import mesh_path
from bodyimage_kin.robot.nearest import nearest_on_shapes

__all__ = ["Finding", "check_embodiment", "refuse_errors"]

_POSTURES, _SAMPLES, _FEW = 2000, 72, 0.05
_SMALLER = (0.04, 0.03, 0.02)
"""Radii of circles that are tried where the one asked for is not reached [m]."""


@dataclass(frozen=True)
class Finding:
    """One thing about a body.

    Attributes:
        level: ``"error"``: what it is about cannot work. ``"note"``: it works, and something will be missed.
        about: ``"joints"``, ``"eye"``, ``"circle"``, ``"touch"``, ``"skin"``, ``"dynamics"``, ``"meshes"`` or
            ``"robot"``.
        text: What it is, and what to do.
    """

    level: Literal["error", "note"]
    about: Literal["joints", "eye", "circle", "touch", "skin", "dynamics", "meshes", "robot"]
    text: str

    def __str__(self) -> str:
        return f"{self.level}: {self.about}: {self.text}"


def check_embodiment(
    body: Embodiment,
    *,
    paper: bool = False,
    radius: float = 0.05,
    distance: float | None = None,
    mesh_folder: Path | None = None,
    file: Path | None = None,
) -> tuple[Finding, ...]:
    """Looks at a body in seconds: what its joints move, its eye sees and its hand reaches, and which files are there.

    Args:
        body: The embodiment.
        paper: Hold it to the protocol of Fuke et al. (2007): the eye sees the whole circle, and never the hand while it
            touches.
        radius: Of the circle that is to be seen [m].
        distance: Of the circle, as in :meth:`Embodiment.circle_frame` [m]; None: 0.03, or, without a skin, the depth at
            which the hand is at home.
        file: The TOML file that the body was read from: a robot from outside its folder is told; None: it was put
            together in code.
        mesh_folder: Where meshes may lie, subfolders included; None: as the robot says, or beside the URDF.

    Returns:
        What was found, errors first; nothing of a body that is fit for all.

    Raises:
        InvalidConfig: A radius or distance that is none.
    """
    _checks.number("radius", radius, above=0.0)
    if distance is not None:
        _checks.number("distance", distance, least=0.0)
    found = [
        *_joints(body),
        *_eye(body),
        *_circle(body, _checks.flag("paper", paper), radius, distance),
        *_touch(body, paper),
        *_skin(body),
        *_dynamics(body),
        *_meshes(body, mesh_folder),
        *_robot(body, file),
    ]
    return tuple(sorted(found, key=lambda finding: finding.level != "error"))


def refuse_errors(body: Embodiment, findings: Sequence[Finding]) -> None:
    """Raises what was found of errors.

    Raises:
        InvalidConfig: One error.
        ManyMistakes: Several.
    """
    place = f"embodiment '{body.name}'"
    errors = [InvalidConfig(f"{place}: {one.about}: {one.text}") for one in findings if one.level == "error"]
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise ManyMistakes(place, errors)


def _joints(body: Embodiment) -> Iterator[Finding]:
    """Joints that the eye never sees the hand moved by."""
    tracker = dataclasses.replace(body, camera=Camera(body.camera.link, body.camera.link_T_camera, Tracker()))
    moved = tracker.hand_image_jacobian(body.felt_robot.sample(16, seed=0)).abs().amax((0, 1))
    still = [joint for joint, size in zip(body.joints, moved.tolist(), strict=True) if size < 1e-12]
    if len(still) == body.p:
        text = "none of the felt joints moves the hand as the eye sees it: they carry both alike, or neither"
        yield Finding("error", "joints", f"{text}; feel joints between camera and hand")
    elif still:
        yield Finding(
            "note",
            "joints",
            f"{', '.join(map(repr, still))} never move the hand as the eye sees it: their columns of Jacobians are 0",
        )


def _eye(body: Embodiment) -> Iterator[Finding]:
    """Whether the eye sees the hand at all."""
    seen = float(body.visible(body.felt_robot.sample(_POSTURES, seed=0)).double().mean())
    if seen == 0.0:
        depth = _depths(body, body.felt_robot.sample(_POSTURES, seed=0))
        yield Finding(
            "error",
            "eye",
            f"it sees the hand in none of {_POSTURES} postures drawn within the limits (depths {depth}); look at "
            f"link_T_camera (z forward){_near(body)} and the model's other numbers",
        )
    elif seen < _FEW:
        yield Finding("note", "eye", f"it sees the hand in {100 * seen:.1g} % of postures drawn within the limits")
    if seen and not bool(body.visible(body.felt_home)):
        yield Finding("note", "eye", f"it does not see the hand at home (depth {_depths(body, body.felt_home[None])})")


def _circle(body: Embodiment, paper: bool, radius: float, distance: float | None) -> Iterator[Finding]:
    """Whether the hand can be led on the circle, and is seen there."""
    if distance is None:
        at_home = float(body.hand_in_camera(body.felt_home)[2])
        distance = 0.03 if body.skin is not None else at_home
        if body.skin is None and at_home <= 0.0:
            text = f"at home the hand is behind the camera (depth {at_home:.3g} m), where no circle is seen"
            yield Finding("note", "circle", f"{text}; give another home, or Circle a distance")
            return
    frame = body.circle_frame(distance)
    angle = np.linspace(0.0, 2 * math.pi, _SAMPLES, endpoint=False)
    aside = np.cos(angle)[:, None] * frame.right + np.sin(angle)[:, None] * frame.down
    q, reached = body.reach(torch.from_numpy(frame.origin + radius * aside))
    what = f"the circle of radius {radius:g} m at distance {distance:.3g} m"
    missed, unseen = int((~reached).sum()), int((reached & ~body.visible(q)).sum())
    if missed:
        # Looked for where some of it is in reach: a circle out of reach as a whole is hardly helped by a radius.
        other = _radius_that_does(body, frame, aside) if missed < _SAMPLES else ""
        yield Finding(
            "error" if paper or missed == _SAMPLES else "note",
            "circle",
            f"the hand cannot reach {missed} of {_SAMPLES} places of {what} within the joint limits; give another "
            f"radius{other}, distance or home",
        )
    if unseen:
        yield Finding(
            "error" if paper or unseen == _SAMPLES else "note",
            "circle",
            f"the eye does not see the hand at {unseen} of {_SAMPLES} places of {what} (depths "
            f"{_depths(body, q[reached])}{_near(body)}); give another radius or distance, or mend the camera",
        )


def _radius_that_does(body: Embodiment, frame: Frame, aside: Float[np.ndarray, "samples 3"]) -> str:
    """The largest of a few smaller radii all whose places are reached and seen, in words, given the unit circle."""

    def does(radius: float, places: Float[np.ndarray, "some 3"]) -> bool:
        q, reached = body.reach(torch.from_numpy(frame.origin + radius * places))
        return bool((reached & body.visible(q)).all())

    # What is out of reach is looked for at length: a few places spare the others.
    found = next((one for one in _SMALLER if does(one, aside[::12]) and does(one, aside)), None)
    return "" if found is None else f" ({found:g} m would do)"


def _touch(body: Embodiment, paper: bool) -> Iterator[Finding]:
    """Whether the hand reaches the skin, and the eye sees it there."""
    if body.skin is None:
        if paper:
            yield Finding("error", "touch", "it has no skin, on which the paper's hand touches; give it one")
        return
    taxels = np.arange(body.skin.count)
    q, reached = body.reach(body.touch_centres(taxels))
    missed = taxels[~reached.numpy()]
    if len(missed):
        yield Finding(
            "error" if paper or len(missed) == len(taxels) else "note",
            "touch",
            f"the hand cannot reach {len(missed)} of {len(taxels)} taxels within the joint limits (first "
            f"{', '.join(map(str, missed[:5]))}); motions on the skin stop there: move the skin, or feel more joints",
        )
    seen = reached & body.visible(q)
    if bool(seen.any()):
        depth = body.hand_in_camera(q)[:, 2]
        deepest = int(torch.where(seen, depth, -math.inf).argmax())
        advice = (
            f"give near above {float(depth[deepest]):.3g} m, or move the camera" if _near(body) else "move the camera"
        )
        yield Finding(
            "error" if paper else "note",
            "touch",
            f"the eye sees the hand while it touches {int(seen.sum())} of {len(taxels)} taxels, up to "
            f"{float(depth[deepest]):.3g} m deep (taxel {deepest}){_near(body)}; "
            + (advice if paper else "recordings have images of touches, which the paper's eye has not"),
        )
    at_reference = body.hand_image(q[body.skin.reference], on_invisible="nan")
    if not bool(at_reference.isfinite().all()):
        yield Finding(
            "error" if paper else "note",
            "touch",
            f"the hand at the reference taxel {body.skin.reference} has no image, to which an integral is reset",
        )


def _skin(body: Embodiment) -> Iterator[Finding]:
    """What is odd of the skin itself: what was mended, pieces of its graph, normals that point inward."""
    skin = body.skin
    if skin is None:
        return
    for note in skin.notes:
        yield Finding("note", "skin", note)
    if skin.shape is None and skin.layout is not None and skin.pieces > 1:
        yield Finding("note", "skin", f"its graph is in {skin.pieces} pieces, between which distances are straight")
    inward = _inward(skin)
    if len(inward):
        named = ", ".join(map(str, inward[:5])) + (" ..." if len(inward) > 5 else "")
        yield Finding(
            "error" if len(inward) == skin.count else "note",
            "skin",
            f"the normals of {len(inward)} of {skin.count} taxels point inward (first {named}): the hand touches these "
            "from inside; turn them round, or give 'inside', a point of the link, for normals that are computed",
        )


def _inward(skin: Skin) -> Int[np.ndarray, "taxels"]:
    """Taxels whose normals point into the link where it has a surface, else against those of their neighbours."""
    normals = skin.link_normals
    if skin.surface:
        _, outward, _ = nearest_on_shapes(skin.surface, skin.link_positions)
        return np.flatnonzero((outward * normals).sum(1) < 0.0)
    around = np.zeros_like(normals)
    for one, other in (skin.neighbours.T, skin.neighbours.T[::-1]):
        np.add.at(around, one, normals[other])
    return np.flatnonzero((around * normals).sum(1) < 0.0)


def _dynamics(body: Embodiment) -> Iterator[Finding]:
    """Whether the arm can be dragged."""
    follower = next((joint.name for joint in body.felt_robot.tree.joints if joint.mimic is not None), None)
    carried = [joint.name for joint in body.felt_robot.path(body.front_link) if joint.kind != "fixed"]
    moving = body.robot.subtree(body.robot.link_names, joints=body.joints, posture=body.home)
    heavy = {
        link: inertial
        for link in moving.link_names
        if any(joint.kind != "fixed" for joint in moving.path(link))
        and (inertial := body.robot.geometry[link].inertial) is not None
        and inertial.mass > 0.0
    }
    why = [
        f"joint '{follower}' follows a felt joint" if follower else "",
        f"felt joint '{carried[-1]}' moves '{body.front_link}', in front of which the hand is dragged"
        if carried
        else "",
        "" if heavy else "no link that the felt joints move has a mass",
        f"link '{body.front_link}' has no shape to be dragged on"
        if body.skin is not None and not body.skin.surface
        else "",
    ]
    if any(why):
        said = ", ".join(filter(None, why))
        yield Finding("note", "dynamics", f"the arm cannot be dragged: {said}; simulate with dynamics=False")
        return
    pointlike = [link for link, inertial in heavy.items() if not any(inertial.moments or ())]
    if pointlike:
        told = ", ".join(map(repr, pointlike[:5])) + (" ..." if len(pointlike) > 5 else "")
        yield Finding(
            "note", "dynamics", f"{told} have a mass and no inertia: dragged as balls of water; give them <inertia>"
        )


def _meshes(body: Embodiment, folder: Path | None) -> Iterator[Finding]:
    """Mesh files that are not there."""
    names, missing = set[str](), dict[str, str]()
    for link, geometry in body.robot.geometry.items():
        shapes = [*(one.shape for one in geometry.visuals), *(one.shape for one in geometry.collisions)]
        for shape in shapes:
            if isinstance(shape, Mesh) and shape.filename not in names:
                names.add(shape.filename)
                try:
                    mesh_path(shape, link, body.robot.file, folder or body.robot.mesh_folder)
                except BodyImageKinError as problem:
                    missing[shape.filename] = str(problem)
    if missing:
        first = next(iter(missing.values()))
        yield Finding("note", "meshes", f"{len(missing)} of {len(names)} mesh files are not found, the first: {first}")


def _robot(body: Embodiment, file: Path | None) -> Iterator[Finding]:
    """A robot that does not travel with the embodiment's file."""
    if file is None or body.robot.file is None:
        return
    place, folder = body.robot.file.resolve(), file.resolve().parent
    if not place.is_relative_to(folder):
        yield Finding(
            "note", "robot", f"'urdf' is read from outside the file's folder: {place}; a copy goes without it"
        )


def _depths(body: Embodiment, q: Float[Tensor, "count p"]) -> str:
    """Least and most depth of the hand."""
    depth = body.hand_in_camera(q)[:, 2]
    least, most = float(depth.min()), float(depth.max())
    return f"{least:.3g} m" if len(depth) == 1 else f"{least:.3g} to {most:.3g} m"


def _near(body: Embodiment) -> str:
    """The camera's near plane, where its model has one."""
    near = getattr(body.camera.model, "near", None)
    return "" if near is None else f", near = {near:g} m"
