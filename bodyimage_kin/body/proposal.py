"""A first body of a robot that nobody described yet: joints, hand, eye, patch of skin and home, and why each.

What is proposed is the experiment of Fuke et al. (2007) on another robot: a hand that is seen while it moves in front
of the face, and never while it touches. Lengths that the paper gives for an infant are kept where the robot's own size
says nothing else.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from bodyimage_kin._arrays import ArrayLike
from bodyimage_kin.backends import kinematics
from bodyimage_kin.body._proposal_links import ahead_of, axes_of, eye_link, felt_joints, skin_link
from bodyimage_kin.body._proposal_skin import balls_of, face_patch, optical_centre, tidy
from bodyimage_kin.body.cameras import Camera, VirtualScreen
from bodyimage_kin.body.check import Finding, check_embodiment
from bodyimage_kin.body.collisions import Hulls
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.body.skin import Skin
from bodyimage_kin.errors import BodyImageKinError, Unreachable
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.shapes import link_parts

__all__ = ["Proposal", "propose"]

_IN_FRONT = (0.05, 0.04, 0.03, 0.06, 0.08)
"""Distances in front of the face at which home is looked for, the infant's first [m]."""
_STARTS, _TOUCHES = 24, 25
_SMALLER = (1.0, 0.8, 0.6, 0.45)
_AT_LIMIT = 1e-3  # [rad or m]
_CLEAR = 0.002  # [m] between the deepest hand that touches and the nearest that is seen
_WIDE = VirtualScreen(distance=0.04, near=1e-4, half_angle=math.radians(80.0))
"""An eye to begin with, until it is known where the hand touches."""


@dataclass(frozen=True)
class Proposal:
    """A body, and the reasons for it.

    Attributes:
        body: The proposed embodiment.
        remarks: What was chosen, and from what, a sentence each.
        findings: What :func:`bodyimage_kin.body.check_embodiment` finds of it by the paper's protocol, collisions
            beside.
    """

    body: Embodiment
    remarks: tuple[str, ...]
    findings: tuple[Finding, ...]

    @property
    def errors(self) -> int:
        """How many things were found that keep the paper's experiment from running."""
        return sum(finding.level == "error" for finding in self.findings)

    @property
    def works(self) -> bool:
        """Whether nothing was found that keeps the paper's experiment from running."""
        return self.errors == 0


def propose(
    robot: Robot,
    hand: str,
    *,
    camera: str | None = None,
    skin: str | None = None,
    forward: ArrayLike | None = None,
    name: str | None = None,
    mesh_folder: str | Path | None = None,
) -> Proposal:
    """Proposes a body: a robot that touches its face.

    Args:
        robot: The robot.
        hand: The link that touches.
        camera: The link that carries the eye; None: the first whose name speaks of an eye, a camera or a head.
        skin: The link that bears the skin; None: the camera's, or the nearest above it that is as large as a face.
        forward: (3,) where the robot looks at home, in the root; None: along x, to the side where the hand moves, or
            else, where the hand does not reach the face from there, the other way.
        name: The body's; None: the robot's.
        mesh_folder: Where meshes may lie, subfolders included; None: where the robot says.

    Returns:
        The body, why it is as it is, and what keeps it from working.

    Raises:
        UnknownName: No such link.
        InvalidConfig: No link named after an eye or a head, no joint between skin and hand, or a forward direction that
            is none.
        InvalidGeometry: A link without any shape for a skin.
        Unreachable: The hand gets nowhere near the face; says by how much.
    """
    folder = None if mesh_folder is None else Path(mesh_folder)
    robot.check_link(hand)
    said: list[str] = []
    try:
        return _proposed(robot, hand, camera, skin, forward, name, folder, said)
    except BodyImageKinError as problem:
        if not getattr(problem, "__notes__", ()):
            problem.add_note("\n".join(said))
        raise


def _proposed(
    robot: Robot, hand: str, camera: str | None, skin: str | None, forward: ArrayLike | None, name: str | None,
    folder: Path | None, said: list[str],
) -> Proposal:  # fmt: skip
    eye = eye_link(robot, hand, camera, folder, said)
    face = skin_link(robot, eye, skin, folder, said)
    joints = felt_joints(robot, hand, face, said)
    hulls = Hulls(robot, joints, folder)
    said.extend(f"hand: {note}" for note in link_parts(robot, hand, folder).notes)
    best: Proposal | None = None
    problems: list[Unreachable] = []
    for palm, where in balls_of(robot, hand, folder):
        first = Embodiment.build(
            robot, joints=joints, hand=palm, camera=Camera(eye, np.eye(4), _WIDE),
            home=robot.named(torch.zeros(robot.n, dtype=torch.float64).clamp(robot.lower, robot.upper)),
            name=robot.name if name is None else name,
        )  # fmt: skip
        of_this = [where]
        try:
            body = _looking(first, face, forward, hulls, folder, of_this)
        except Unreachable as problem:
            problem.add_note("\n".join([*said, *of_this]))
            problems.append(problem)
            continue
        findings = (*check_embodiment(body, paper=True, mesh_folder=folder), *_hit(body, hulls))
        found = Proposal(body, (*said, *of_this), findings)
        if best is None or found.errors < best.errors:
            best = found
        if best.works:
            break
    if best is None:
        raise problems[0]
    return best


def _looking(
    first: Embodiment, face: str, forward: ArrayLike | None, hulls: Hulls, folder: Path | None, said: list[str]
) -> Embodiment:
    """:func:`_facing` the direction that was asked for, or else the likelier way along x, or else the other."""
    if forward is not None:
        return _facing(first, face, axes_of(forward), hulls, folder, said)
    ahead = ahead_of(first.robot, first.hand.link, first.joints, said)
    try:
        return _facing(first, face, axes_of(ahead), hulls, folder, said)
    except Unreachable as problem:
        said.append(f"forward: {problem}")
    body = _facing(first, face, axes_of(-ahead), hulls, folder, said)
    said.append(f"forward: the other way, {'-' if ahead[0] > 0 else ''}x of the root, where it does")
    return body


def _facing(
    first: Embodiment, face: str, axes: Float[np.ndarray, "3 3"], hulls: Hulls, folder: Path | None, said: list[str]
) -> Embodiment:
    """A body with skin, eye and home, if its robot looks along the last of these axes.

    Args:
        first: Its robot, joints and hand.
        face: The link that bears the skin.
        axes: Columns right, down, forward, in the root.
        hulls: What may collide.
        folder: Where meshes may lie.
        said: Remarks.

    Raises:
        InvalidGeometry: No room for the skin.
        Unreachable: The hand gets nowhere near the face.
    """
    eye = first.camera.link
    root_T_face, root_T_eye = (kinematics(first.robot).pose(first.home, link).numpy() for link in (face, eye))
    for share in _SMALLER:
        of_this = list[str]()
        patch = face_patch(first.robot, face, tidy(root_T_face[:3, :3].T @ axes), folder, share, of_this)
        optical = optical_centre(patch, root_T_face, root_T_eye, axes, of_this)
        with_skin = _rebuilt(first, skin=patch, camera=Camera(eye, optical, _WIDE))
        body, all_reached = _with_eye(_at_home(with_skin, hulls, of_this), of_this)
        if all_reached:
            break
    said.extend(of_this)
    return body


# Home, and what the eye sees ------------------------------------------------------------------------------------------


def _at_home(body: Embodiment, hulls: Hulls, said: list[str]) -> Embodiment:
    """The same body with its hand in front of the face: clear of collisions, far from its joint limits."""
    lower, upper = body.felt_robot.lower, body.felt_robot.upper
    finite = lower.isfinite() & upper.isfinite()
    low, high = torch.where(finite, lower, -torch.pi / 2), torch.where(finite, upper, torch.pi / 2)
    engine = torch.quasirandom.SobolEngine(body.p)  # type: ignore[no-untyped-call]
    shares = torch.cat([torch.full((1, body.p), 0.5), 0.15 + 0.7 * engine.draw(_STARTS)]).double()
    starts = [body.felt_home, *(low + shares * (high - low))]
    gap, nearest = math.inf, starts[0]
    for distance in _IN_FRONT:
        target = body.touch_centres([body.require_skin().middle], distance)
        tried: list[tuple[int, float, Tensor]] = []
        for start in starts:
            q, reached = replace(body, home=body.full_posture(start)).reach(target)
            here = float(torch.linalg.vector_norm(body.hand_in_front_and_jacobian(q)[0] - target))
            gap, nearest = min((gap, nearest), (here, q[0]), key=lambda one: one[0])
            if not bool(reached.all()):
                # It has been looked for from all over the joint space already.
                break
            if bool(body.visible(q[0])):
                hits = len(hulls.collisions(body.full_posture(q[0])))
                margin = float(torch.minimum((q[0] - low) / (high - low), (high - q[0]) / (high - low)).min())
                tried.append((hits, -round(margin, 3), q[0]))
        if tried:
            best = min(tried, key=lambda one: one[:2])
            said.append(
                f"home: the hand {1e3 * distance:.0f} mm in front of the middle taxel, found by inverse kinematics"
            )
            near = torch.round(best[2], decimals=3).clamp(lower, upper)
            values = dict(zip(body.joints, near.tolist(), strict=True))
            return _rebuilt(body, home=body.robot.named(body.home) | values)
    skin = body.require_skin()
    what = (
        f"gets no nearer than {1e3 * gap:.0f} mm to a place in front of link '{skin.link}'{_held(body, nearest)}"
        if gap > 1e-3
        else f"gets in front of link '{skin.link}' only where its eye does not see it"
    )
    raise Unreachable(
        f"hand '{body.hand.link}' {what}; name another hand, skin or camera, or a forward direction", [skin.middle]
    )


def _held(body: Embodiment, q: Float[Tensor, "p"]) -> str:
    """Which joint limits hold the hand back at its nearest posture, in words."""
    lower, upper = body.felt_robot.lower, body.felt_robot.upper
    still = [name for name, span in zip(body.joints, (upper - lower).tolist(), strict=True) if span < _AT_LIMIT]
    if still:
        return f", for {', '.join(map(repr, still))} cannot move (look at <limit>)"
    margin = torch.minimum(q - lower, upper - q).tolist()
    held = [name for name, rest in zip(body.joints, margin, strict=True) if rest < _AT_LIMIT]
    return f", where {', '.join(map(repr, held))} stand at their limits" if held else ""


def _with_eye(body: Embodiment, said: list[str]) -> tuple[Embodiment, bool]:
    """The same body with the numbers of its eye: the touching hand hidden, the screen where it touches.

    Returns:
        The body, and whether its hand reaches every taxel.
    """
    centres = body.touch_centres(np.arange(body.require_skin().count))
    q, reached = body.reach(centres)
    if not bool(reached.any()):
        return body, False
    depths = body.hand_in_camera(q[reached])[:, 2]
    near = round(float(depths.max()) + _CLEAR, 3)
    screen = VirtualScreen(round(float(depths.median()), 3), near, math.radians(60.0))
    said.append(
        f"eye: virtual screen at {1e3 * screen.distance:.0f} mm, the middle depth of a hand that touches; nothing is "
        f"seen nearer than {1e3 * near:.0f} mm, so that no touch is"
    )
    return _rebuilt(body, camera=Camera(body.camera.link, body.camera.link_T_camera, screen)), bool(reached.all())


def _rebuilt(
    body: Embodiment,
    *,
    home: Mapping[str, float] | None = None,
    camera: Camera | None = None,
    skin: Skin | None = None,
) -> Embodiment:
    return Embodiment.build(
        body.robot,
        joints=body.joints,
        hand=body.hand,
        camera=camera or body.camera,
        skin=skin or body.skin,
        home=body.robot.named(body.home) if home is None else home,
        name=body.name,
    )


def _hit(body: Embodiment, hulls: Hulls) -> tuple[Finding, ...]:
    """Collisions at home and while touching, as findings; that the hand meets the face is no finding."""
    found = []
    at_home = hulls.collisions(body.home)
    if at_home:
        found.append(
            Finding(
                "note",
                "joints",
                f"at home {_named(at_home)} overlap (convex hulls); look at the picture, and give another home",
            )
        )
    skin = body.require_skin()
    some = np.unique(np.linspace(0, skin.count - 1, _TOUCHES).round().astype(int))
    q, reached = body.reach(body.touch_centres(some))
    hand = hulls.beyond(body.hand.link)
    hits = [
        [pair for pair in hulls.collisions(body.full_posture(one))
         if pair not in at_home and not (skin.link in pair and set(pair) & hand)]
        for one in q[reached]
    ]  # fmt: skip
    if any(hits):
        worst = [pair for pair, _ in Counter(pair for pairs in hits for pair in pairs).most_common()]
        found.append(
            Finding(
                "note",
                "touch",
                f"at {sum(map(bool, hits))} of {len(hits)} taxels looked at {_named(worst)} overlap while the hand "
                "touches (convex hulls); move the skin, feel more joints, or give another home, from which the arm "
                "comes another way",
            )
        )
    return tuple(found)


def _named(pairs: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"'{one}' and '{other}'" for one, other in pairs[:3]) + (" ..." if len(pairs) > 3 else "")
