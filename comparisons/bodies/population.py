"""The population of infants: what varies between bodies, and what a body sees before it touches its face.

Everything is drawn anew for each body from its own random stream. A body is kept if it can do what the experiment asks:
touch all 441 taxels unseen, and see its hand on the whole of each circle. One that cannot is drawn again, and how often
that happened is part of the results.
"""

from __future__ import annotations

import math
import tomllib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.spatial.transform
import tomli_w

import bodyimage_kin as bk
from bodyimage_kin.body import check_embodiment
from bodyimage_kin.errors import BodyImageKinError
from bodyimage_kin.study.random_streams import stream

INFANT = Path(__file__).parents[2] / "urdf" / "infant.toml"
ARM = ("left_shoulder_pitch", "left_shoulder_roll", "left_shoulder_yaw", "left_elbow", "left_wrist")
FACES = {
    # Where the shape's centre is behind the front of the face, and the shape as a URDF says it.
    "sphere": (0.0724, '<sphere radius="0.0724"/>', "0 0 0"),
    "wide sphere": (0.11, '<sphere radius="0.11"/>', "0 0 0"),
    "upright cylinder": (0.06, '<cylinder radius="0.06" length="0.15"/>', "0 0 0"),
    "lying cylinder": (0.06, '<cylinder radius="0.06" length="0.15"/>', "1.5707963267948966 0 0"),
    "flat": (0.05, '<box size="0.1 0.15 0.15"/>', "0 0 0"),
}
"""Five shapes of face; all have their front where the infant has its nose, 72.4 mm in front of the head's middle."""
FRONT, MIDDLE = 0.0724, 0.06
DEPTHS = (0.02, 0.04, 0.06)
"""Distances of the three circles of ``several_depths`` [m]."""
_TRIES = 200


@dataclass(frozen=True)
class Individual:
    """One infant of the population.

    Attributes:
        number: Of the infant.
        arm: Length of its arm over that of the infant that comes with the package, log-uniform in 0.7 to 1.5.
        tilt: Turn of each felt joint's axis, of normal components [degrees].
        optical_centre: How far behind the face it is, uniform in 0.02 to 0.08 [m].
        face: One of :data:`FACES`, all alike.
        radius: Of the circle, uniform in 0.025 to 0.06 [m].
        distance: Of the circle in front of touching, uniform in 0.015 to 0.06 [m].
        torque: Standard deviation of the torque on the hand, log-uniform in 0.05 to 0.2 [N m].
        encoder: Of the joints felt, log-uniform in 0.5 to 2 mrad [rad].
        image: Of the hand's image, log-uniform in 0.1 to 0.4 mm [m].
        tries: How many were drawn until one could do what is asked.
    """

    number: int
    arm: float
    tilt: tuple[tuple[float, float, float], ...]
    optical_centre: float
    face: str
    radius: float
    distance: float
    torque: float
    encoder: float
    image: float
    tries: int = 1

    @property
    def noise(self) -> bk.Noise:
        """On the hand's torque, the encoders and the image."""
        return bk.Noise(torque=self.torque, encoder=self.encoder, image=self.image)

    def circles(self, recording: str) -> tuple[bk.motions.Circle, ...]:
        """What is seen: three turns at one distance, or one turn at each of three."""
        if recording == "circle":
            return (bk.motions.Circle(radius=self.radius, distance=self.distance),)
        return tuple(bk.motions.Circle(radius=self.radius, distance=distance, turns=1.0) for distance in DEPTHS)

    def body(self, folder: Path) -> bk.Embodiment:
        """The body, written into a folder and read like anybody's."""
        folder.mkdir(parents=True, exist_ok=True)
        table = tomllib.loads(INFANT.read_text(encoding="utf-8"))
        (folder / "body.urdf").write_text(self.urdf(), encoding="utf-8")
        table |= {"name": f"infant_{self.number:02d}", "urdf": "body.urdf"}
        # As on the infant, what touches the face is nearer than the nearest visible depth.
        table["camera"]["near"] = self.optical_centre + 0.03
        path = folder / "body.toml"
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
        body = bk.load_embodiment(path)
        # At rest the fist is 5 cm in front of the nose, whatever the length of the arm.
        middle = body.skin.count // 2
        table["home"] |= dict(zip(body.joints, body.touch_postures([middle], 0.05)[0].tolist(), strict=True))
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
        return bk.load_embodiment(path)

    def urdf(self) -> str:
        """The robot, as a URDF."""
        tree = ElementTree.parse(INFANT.with_name("infant.urdf"))
        joints = {joint.get("name"): joint for joint in tree.getroot().iter("joint")}
        for name, degrees in zip(ARM, self.tilt, strict=True):
            turn = scipy.spatial.transform.Rotation.from_rotvec(degrees, degrees=True)
            joints[name].find("origin").set("rpy", " ".join(map(repr, map(float, turn.as_euler("xyz")))))
        for name in ("left_elbow", "left_wrist", *(n for n, j in joints.items() if _parent(j) == "left_palm")):
            _scale(joints[name].find("origin"), self.arm)
        for eye in ("left_eye_centre", "right_eye_centre"):
            origin = joints[eye].find("origin")
            x, y, z = map(float, origin.get("xyz").split())
            origin.set("xyz", f"{x + 0.02 - self.optical_centre!r} {y} {z}")
        behind, shape, rpy = FACES[self.face]
        head = next(link for link in tree.getroot().iter("link") if link.get("name") == "head")
        collision = head.find("collision")
        collision.find("origin").set("xyz", f"{FRONT - behind!r} 0 {MIDDLE}")
        collision.find("origin").set("rpy", rpy)
        geometry = collision.find("geometry")
        geometry.clear()
        geometry.append(ElementTree.fromstring(shape))
        return ElementTree.tostring(tree.getroot(), encoding="unicode")


def _parent(joint: ElementTree.Element) -> str | None:
    return joint.find("parent").get("link")


def _scale(origin: ElementTree.Element, factor: float) -> None:
    origin.set("xyz", " ".join(repr(factor * float(value)) for value in origin.get("xyz").split()))


def drawn(number: int, folder: Path, seed: int = 0) -> tuple[Individual, bk.Embodiment]:
    """An infant of the population and its body; the first of its stream that can do what is asked.

    Args:
        number: Of the infant; each has a stream of its own.
        folder: Where the body's files go.
        seed: Of the population.
    """
    rng = np.random.default_rng(stream(seed, f"bodies/{number}", 4))
    for tries in range(1, _TRIES + 1):
        one = Individual(
            number,
            arm=_log_uniform(rng, 0.7, 1.5),
            tilt=tuple(tuple(map(float, rng.normal(0.0, 3.0, 3))) for _ in ARM),
            optical_centre=float(rng.uniform(0.02, 0.08)),
            face=str(rng.choice(list(FACES))),
            radius=float(rng.uniform(0.025, 0.06)),
            distance=float(rng.uniform(0.015, 0.06)),
            torque=_log_uniform(rng, 0.05, 0.2),
            encoder=_log_uniform(rng, 5e-4, 2e-3),
            image=_log_uniform(rng, 1e-4, 4e-4),
            tries=tries,
        )
        try:
            body = one.body(folder)
            distances = {circle.distance for name in ("circle", "several_depths") for circle in one.circles(name)}
            wrong = [
                finding
                for distance in distances
                for finding in check_embodiment(body, paper=True, radius=one.radius, distance=distance)
                if finding.level == "error"
            ]
        except BodyImageKinError:
            continue
        if not wrong:
            return one, body
    raise RuntimeError(f"none of {_TRIES} infants drawn as number {number} can do what is asked")


def _log_uniform(rng: np.random.Generator, least: float, most: float) -> float:
    return float(math.exp(rng.uniform(math.log(least), math.log(most))))
