"""Every reading as a study: recordings and rows that differ in one thing each, and infants of other arms."""

from __future__ import annotations

import dataclasses
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bodyimage_kin import _checks
from bodyimage_kin.body import Embodiment, load_embodiment
from bodyimage_kin.errors import InvalidConfig, UnknownName
from bodyimage_kin.metrics.probes import Face
from bodyimage_kin.published.ambiguities.readings import AMBIGUITIES, INFANT, STREAM, Place
from bodyimage_kin.published.ambiguities.scores import FACTS, SCORES
from bodyimage_kin.recordings import Noise
from bodyimage_kin.recordings.motions import Circle, FaceTour, RandomTouch
from bodyimage_kin.study import Simulation, Study
from bodyimage_kin.study.store import body_files

__all__ = ["ARMS", "grid", "infant_with_arm", "places", "recordings"]

ARMS: Mapping[str, float] = {"shorter_arm": 0.9, "longer_arm": 1.15}
"""Embodiment -> factor of the lengths of upper arm and forearm."""


def grid(
    seeds: int | Sequence[int] = 30, duration: float | int = 200.0, ambiguities: Sequence[str] = tuple(AMBIGUITIES)
) -> Study:
    """Every reading of these ambiguities as a study.

    Args:
        seeds: Recordings of each motion: how many, or which.
        duration: How long the face is touched [s].
        ambiguities: Names of ``AMBIGUITIES``.

    Raises:
        InvalidConfig: A setting out of range.
        UnknownName: No such ambiguity.
    """
    wanted = places(ambiguities)
    needed = {place.recording for place in wanted}
    on: dict[str, dict[str, None]] = {}
    for place in wanted:
        on.setdefault(place.name, {})[f"{place.embodiment}/{place.recording}"] = None
    bodies: dict[str, Any] = {INFANT: INFANT}
    bodies |= {name: infant_with_arm(ARMS[name]) for name in ARMS if any(one.embodiment == name for one in wanted)}
    return Study(
        bodies,
        {name: one for name, one in recordings(duration).items() if name in needed},
        {one.name: dataclasses.replace(one.row, on=tuple(on[one.name])) for one in wanted},
        probes={"on_face": Face()},
        seeds=seeds,
        scores=SCORES,
        facts=FACTS,
        # An onlooker weighs errors by how the arm truly moves.
        metric_of="true",
    )


def places(ambiguities: Sequence[str] = tuple(AMBIGUITIES)) -> list[Place]:
    """Where the readings of these ambiguities stand, each place once.

    Raises:
        InvalidConfig: No ambiguity.
        UnknownName: No such ambiguity.
    """
    if isinstance(ambiguities, str) or not ambiguities:
        raise InvalidConfig(f"ambiguities={ambiguities!r}: give at least one name, in a list")
    for name in ambiguities:
        if name not in AMBIGUITIES:
            raise UnknownName("ambiguity", name, AMBIGUITIES)
    found = {
        reading.place(motion): None
        for name in ambiguities
        for motion in AMBIGUITIES[name].motions
        for reading in AMBIGUITIES[name].readings
    }
    return list(found)


def recordings(duration: float | int = 200.0) -> dict[str, Simulation]:
    """Every recording: the motion, and after an underscore what is other than usual.

    Args:
        duration: How long the face is touched [s].

    Raises:
        InvalidConfig: A duration that is no positive number.
    """
    touching = RandomTouch(_checks.number("duration", duration, above=0.0))

    def made(circle: Mapping[str, float] = {}, touch: Mapping[str, Any] = {}, **moved: Any) -> Simulation:
        use = dataclasses.replace(touching, **touch)
        return Simulation(Circle(**circle), use=use, tour=FaceTour(), stream=STREAM, **moved)

    usual: dict[str, dict[str, Any]] = {"kinematic": {"dynamics": False}, "noise": {"noise": Noise(torque=0.1)}}
    found: dict[str, Simulation] = {}
    for motion, moved in usual.items():
        found |= {
            motion: made(**moved),
            # The maps' own silence is to be all there is.
            f"{motion}_without_silence": made(touch={"silence": 0.0}, **moved),
            f"{motion}_1.5_cm_in_front": made({"distance": 0.015}, **moved),
            f"{motion}_6_cm_in_front": made({"distance": 0.06}, **moved),
            f"{motion}_10_cm_in_front": made({"distance": 0.1}, **moved),
            f"{motion}_radius_3_cm": made({"radius": 0.03}, **moved),
        }
    for name, interval in {"every_5_s": 5.0, "every_30_s": 30.0, "at_the_start": None}.items():
        found[f"noise_reset_{name}"] = made(touch={"reset_interval": interval}, **usual["noise"])
    return found | {
        "noise_of_torque_0.01": made(noise=Noise(torque=0.01)),
        "noise_held_20_ms": made(noise=Noise(torque=0.1, torque_hold=0.02)),
        "noise_held_100_ms": made(noise=Noise(torque=0.1, torque_hold=0.1)),
        "noise_of_joints_0.1_rad": made(noise=Noise(encoder=0.1)),
        "noise_of_joints_0.01_rad": made(noise=Noise(encoder=0.01)),
        "noise_of_joints_0.001_rad": made(noise=Noise(encoder=0.001)),
        "noise_free": made(),
    }


def infant_with_arm(factor: float | int) -> Embodiment:
    """The infant with upper arm and forearm longer by a factor; the hand, the head and the masses stay.

    Args:
        factor: Of the distances from shoulder to elbow and from elbow to wrist, of the arm that is felt.

    Raises:
        InvalidConfig: A factor that is no positive number.
    """
    factor = _checks.number("factor", factor, above=0.0)
    infant = load_embodiment(INFANT)
    tree = ET.fromstring(infant.robot.source)
    for joint in tree.iter("joint"):
        if joint.get("name") in ("left_elbow", "left_wrist") and (origin := joint.find("origin")) is not None:
            origin.set("xyz", " ".join(str(factor * float(part)) for part in origin.attrib["xyz"].split()))
    files = {name: ET.tostring(tree) if name.endswith(".urdf") else data for name, data in body_files(infant).items()}
    with tempfile.TemporaryDirectory() as folder:
        for name, data in files.items():
            Path(folder, name).write_bytes(data)
        return load_embodiment(Path(folder, "embodiment.toml"))
