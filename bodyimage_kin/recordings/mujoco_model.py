"""A MuJoCo model of a body whose felt joints move passively; all that no felt joint moves is the world.

It is built from the checked tree and the inertials of the robot's source, one MuJoCo body for all links that move as
one. Nothing is left to a URDF parser, and none of the robot's names reaches MuJoCo, which keeps ``world`` for itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Int

from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig, InvalidGeometry, InvalidURDF
from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.geometry import Inertial
from bodyimage_kin.robot.shapes import Shape
from bodyimage_kin.robot.transforms import Matrix4
from bodyimage_kin.robot.tree import Joint
from bodyimage_kin.robot.triangles import Triangles

__all__ = ["CONTACT_TIME", "LEAST_INERTIA", "LEAST_MASS", "NO_LIMIT", "build", "joint_columns"]

_GEOMS = {
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}
LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-9
_WATER = 1000.0  # [kg/m^3]
"""Of links that weigh nothing between two joints [kg, kg m^2]: MuJoCo moves no massless body."""
NO_LIMIT = 1e9
"""Stands for the missing limit of a joint that has one only [rad or m]."""
CONTACT_TIME = 0.004
"""Time constant with which contacts and joint limits recover [s], MuJoCo's ``solref``; twice the step is its least."""


@dataclass
class _Body:
    """Links that move as one: the MuJoCo body, and the mass gathered so far."""

    element: Any
    masses: list[float] = field(default_factory=list)
    centres: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    inertias: list[Float[np.ndarray, "3 3"]] = field(default_factory=list)

    def add(self, inertial: Inertial, body_T_link: Matrix4) -> None:
        """Adds a link's inertial."""
        place = body_T_link @ inertial.origin
        self.masses.append(inertial.mass)
        self.centres.append(place[:3, 3])
        self.inertias.append(place[:3, :3] @ inertial.inertia @ place[:3, :3].T)

    def weigh(self) -> None:
        """Gives the MuJoCo body all mass that was added (parallel axis theorem)."""
        self.element.explicitinertial = True
        mass = sum(self.masses)
        if mass == 0.0:
            self.element.mass, self.element.inertia = LEAST_MASS, [LEAST_INERTIA] * 3
            return
        centre = sum((m * c for m, c in zip(self.masses, self.centres, strict=True)), np.zeros(3)) / mass
        total = np.zeros((3, 3))
        for m, c, inertia in zip(self.masses, self.centres, self.inertias, strict=True):
            arm = c - centre
            total += inertia + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        if np.abs(total).max() < 1e-3 * LEAST_INERTIA:
            total = _ball_of_water(mass) * np.eye(3)
        self.element.mass, self.element.ipos = mass, centre
        self.element.fullinertia = [*np.diag(total), total[0, 1], total[0, 2], total[1, 2]]


def _ball_of_water(mass: float) -> float:
    """Moment of inertia of a ball of water [kg m^2], which stands for that of a link whose file says zero."""
    return 0.4 * mass * (3.0 * mass / (4.0 * math.pi * _WATER)) ** (2.0 / 3.0)


def build(
    body: Embodiment,
    *,
    step: float,
    stiffness: float,
    damping: float,
    joint_damping: float,
    rest_stiffness: float,
    friction: float,
) -> mujoco.MjModel:
    """The felt part of an embodiment, its hand tied to a target by a spring and a damper.

    Six controls: the target of the hand's centre in the axes of ``front_link`` [m], and a torque on the hand's link in
    that link's axes [N m]. The force on the hand is ``stiffness (control - x) - damping v`` in every component. Joint
    values stand where :func:`joint_columns` says. The hand is a sphere that touches the shapes of the skin's link, of a
    mesh its convex hull, and nothing else; there is no gravity. The spring towards rest pulls each joint to
    ``qpos_spring`` (zero here).

    Args:
        body: The embodiment.
        step: Of the simulation [s].
        stiffness: Of the spring at the hand [N/m].
        damping: Of the damper at the hand [N s/m].
        joint_damping: [N m s/rad] (N s/m of a prismatic joint).
        rest_stiffness: [N m/rad] (N/m).
        friction: Coefficient of the hand on the skin; 0: none.

    Raises:
        InvalidConfig: A felt joint that others follow, or that moves the skin.
        InvalidURDF: Moving links without mass, or with one that no rigid body has.
    """
    robot = body.robot.subtree(body.robot.link_names, joints=body.joints, posture=body.home).reordered(body.joints)
    follower = next((joint.name for joint in robot.tree.joints if joint.mimic is not None), None)
    if follower is not None:
        raise InvalidConfig(f"dynamics: joint '{follower}' follows a felt joint; use an embodiment without such joints")
    front = body.front_link
    if any(joint.kind != "fixed" for joint in body.felt_robot.path(front)):
        # A target that moved with the skin would push the skin away by the force on the hand.
        kind = "camera" if body.skin is None else "skin"
        raise InvalidConfig(
            f"dynamics: a felt joint moves the {kind}'s link '{front}'; feel others only, or use dynamics=False"
        )
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.timestep = step
    spec.option.gravity = [0.0, 0.0, 0.0]
    # Dampers enter implicitly: a fist weighs so little that the joint damping's time constant is below the step.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # A simulation that fails must be seen to fail, not start again from zero; and a hand may touch its parent body.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET | mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    places = _add_links(spec, robot, joint_damping=joint_damping, rest_stiffness=rest_stiffness)

    carrier, body_T_link = places[body.hand.link]
    centre = body_T_link[:3, :3] @ body.hand.offset.numpy() + body_T_link[:3, 3]
    quaternion = _quaternion(body_T_link)
    carrier.add_site(name="hand", pos=centre, quat=quaternion)
    contact = {"condim": 3 if friction else 1, "friction": [friction, 0.0, 0.0], "solref": [CONTACT_TIME, 1.0]}
    sphere = [body.hand.radius, 0.0, 0.0]
    if body.skin is not None:
        carrier.add_geom(
            name="hand", type=_GEOMS["sphere"], size=sphere, pos=centre, contype=1, conaffinity=0, **contact
        )
    carrier, body_T_link = places[front]
    carrier.add_site(name="front", pos=body_T_link[:3, 3], quat=_quaternion(body_T_link))
    for index, shape in enumerate(() if body.skin is None else body.skin.touched_surface):
        if isinstance(shape, Triangles):
            vertices = shape.vertices @ body_T_link[:3, :3].T + body_T_link[:3, 3]
            spec.add_mesh(name=f"hull{index}", uservert=vertices.ravel(), userface=shape.faces.ravel())
            carrier.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"hull{index}", contype=0, conaffinity=1, **contact
            )
        else:
            _add_shape(carrier, shape, body_T_link, contype=0, conaffinity=1, **contact)

    for axis in range(3):
        drag = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_SITE, target="hand", refsite="front", gear=_unit(axis))
        drag.set_to_position(kp=stiffness, kv=damping)
    for axis in range(3):
        torque = spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_SITE, target="hand", gear=_unit(3 + axis))
        torque.set_to_motor()
    try:
        return spec.compile()
    except ValueError as problem:
        raise InvalidURDF(
            f"MuJoCo refuses the robot's dynamics: {' '.join(str(problem).split())}",
            remedy="mend mass and inertia of its moving links",
        ) from None


def joint_columns(model: mujoco.MjModel) -> Int[np.ndarray, "p"]:
    """Where MuJoCo keeps the values of the felt joints, in the embodiment's order."""
    return np.array([model.joint(f"joint{index}").qposadr[0] for index in range(model.njnt)])


def _add_links(
    spec: mujoco.MjSpec, robot: Robot, *, joint_damping: float, rest_stiffness: float
) -> dict[str, tuple[Any, Matrix4]]:
    """Adds bodies and joints; where each link went: its MuJoCo body, and its place in that."""
    world = _Body(spec.worldbody)
    bodies: list[_Body] = []
    places: dict[str, tuple[_Body, Matrix4]] = {robot.root: (world, np.eye(4))}
    children: dict[str, list[Joint]] = {}
    for joint in robot.tree.joints:
        children.setdefault(joint.parent, []).append(joint)
    waiting = list(children.get(robot.root, []))
    while waiting:
        joint = waiting.pop()
        here, body_T_link = places[joint.parent]
        place = body_T_link @ joint.origin
        if joint.kind != "fixed":
            element = here.element.add_body(pos=place[:3, 3], quat=_quaternion(place))
            bounded = math.isfinite(joint.lower) or math.isfinite(joint.upper)
            element.add_joint(
                name=f"joint{robot.joint_index(joint.name)}",
                type=mujoco.mjtJoint.mjJNT_SLIDE if joint.kind == "prismatic" else mujoco.mjtJoint.mjJNT_HINGE,
                axis=joint.axis,
                limited=mujoco.mjtLimited.mjLIMITED_TRUE if bounded else mujoco.mjtLimited.mjLIMITED_FALSE,
                range=[max(joint.lower, -NO_LIMIT), min(joint.upper, NO_LIMIT)] if bounded else [0.0, 0.0],
                damping=joint_damping,
                stiffness=rest_stiffness,
                solref_limit=[CONTACT_TIME, 1.0],
            )
            here, place = _Body(element), np.eye(4)
            bodies.append(here)
        places[joint.child] = (here, place)
        if here is not world and (inertial := _inertial(robot, joint.child)) is not None:
            here.add(inertial, place)
        waiting.extend(children.get(joint.child, []))
    if not any(sum(moving.masses) for moving in bodies):
        raise InvalidURDF(
            "no link that the felt joints move has a mass", remedy="give the moving links an <inertial> in the URDF"
        )
    for moving in bodies:
        moving.weigh()
    return {link: (here.element, place) for link, (here, place) in places.items()}


def _inertial(robot: Robot, link: str) -> Inertial | None:
    """The inertial of a link, None when it has none."""
    geometry = robot.geometry[link]
    try:
        geometry.check("inertial")
    except InvalidGeometry as problem:
        raise InvalidURDF(f"mass and inertia are needed here: {problem}") from None
    if geometry.inertial is not None and geometry.inertial.moments is None:
        raise InvalidURDF("its inertial has no inertia", element=f"link '{link}'", remedy="add <inertia>")
    return geometry.inertial


def _add_shape(carrier: Any, shape: Shape, body_T_link: Matrix4, **contact: Any) -> None:
    place = body_T_link @ shape.link_T_shape
    size = [*shape.size, 0.0, 0.0][:3]
    carrier.add_geom(type=_GEOMS[shape.kind], size=size, pos=place[:3, 3], quat=_quaternion(place), **contact)


def _quaternion(place: Matrix4) -> Float[np.ndarray, "4"]:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, place[:3, :3].flatten())
    return quaternion


def _unit(axis: int) -> list[float]:
    return [1.0 if index == axis else 0.0 for index in range(6)]
