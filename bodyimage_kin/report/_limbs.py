"""What a robot is made of, limb by limb, as rows of a table: limits, lengths and masses as the URDF has them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bodyimage_kin.robot import Robot
from bodyimage_kin.robot.tree import Joint


@dataclass(frozen=True)
class JointSpecification:
    """One joint and what it moves, up to the next.

    Attributes:
        joint: As in the URDF.
        length: From this joint to the next of its limb, or to the link at its end [m]; None when no such link is known.
        mass: Of all that is rigidly moved by it before the next joint [kg]; None when the URDF gives none.
    """

    joint: Joint
    length: float | None
    mass: float | None

    @property
    def limits(self) -> str:
        """Lower and upper limit as text: degrees, or millimetres with their unit."""
        if self.joint.mimic is not None:
            return f"follows {self.joint.mimic.joint}"
        if not math.isfinite(self.joint.lower) or not math.isfinite(self.joint.upper):
            return "unlimited"
        if self.joint.kind == "prismatic":
            return f"{_whole(1000 * self.joint.lower)} to {_whole(1000 * self.joint.upper)} mm"
        return f"{_whole(math.degrees(self.joint.lower))} to {_whole(math.degrees(self.joint.upper))}"


@dataclass(frozen=True)
class Limb:
    """A chain of joints without a branch.

    Attributes:
        base: The link it hangs from.
        tip: The last link of the chain.
        joints: From base to tip.
    """

    base: str
    tip: str
    joints: tuple[JointSpecification, ...]

    @property
    def degrees_of_freedom(self) -> int:
        """Number of joints that follow no other."""
        return sum(row.joint.mimic is None for row in self.joints)


def limbs(robot: Robot) -> tuple[Limb, ...]:
    """The robot's limbs, in the order of their first joints in the file."""
    masses = link_masses(robot)
    below: dict[str, list[Joint]] = {}
    for joint in robot.tree.joints:
        below.setdefault(joint.parent, []).append(joint)

    def rigid(link: str) -> list[tuple[str, Float[np.ndarray, "4 4"]]]:
        """The link and all that is fixed to it, with where each is in the link."""
        found = [(link, np.eye(4))]
        for name, place in found:
            found += [(joint.child, place @ joint.origin) for joint in below.get(name, ()) if joint.kind == "fixed"]
        return found

    def following(link: str) -> list[tuple[Joint, Float[np.ndarray, "3"]]]:
        """The joints that hang from what is rigid with a link, with where each is in the link."""
        return [
            (joint, (place @ [*joint.xyz, 1.0])[:3])
            for name, place in rigid(link)
            for joint in below.get(name, ())
            if joint.kind != "fixed"
        ]

    def limb(first: Joint) -> Limb:
        rows, joint = [], first
        while True:
            parts, further = rigid(joint.child), following(joint.child)
            known = [masses[name] for name, _ in parts if name in masses]
            # The end of a limb is the one link fixed to the last; a head with two eyes ends in itself.
            tip, place = parts[-1] if len(parts) == 2 and not further else parts[0]
            reach = further[0][1] if len(further) == 1 else place[:3, 3]
            single = len(further) == 1 or (not further and len(parts) == 2)
            length = float(np.linalg.norm(reach)) if single else None
            rows.append(JointSpecification(joint, length, sum(known) if known else None))
            if len(further) != 1:
                return Limb(first.parent, tip, tuple(rows))
            joint = further[0][0]

    parts, firsts = [robot.root], []
    for part in parts:
        # A new limb begins at each joint of the trunk, and wherever a limb branches.
        for joint, _ in following(part):
            found = limb(joint)
            firsts.append(found)
            last = found.joints[-1].joint.child
            if following(last):
                parts.append(last)
    order = {joint.name: index for index, joint in enumerate(robot.tree.joints)}
    return tuple(sorted(firsts, key=lambda one: order[one.joints[0].joint.name]))


def link_masses(robot: Robot) -> dict[str, float]:
    """The masses that the URDF gives, by link [kg]."""
    return {link: geometry.inertial.mass for link, geometry in robot.geometry.items() if geometry.inertial is not None}


def _whole(value: float) -> str:
    """Rounded, with a true minus sign and no negative zero."""
    return f"{round(value):d}".replace("-", "\N{MINUS SIGN}")
