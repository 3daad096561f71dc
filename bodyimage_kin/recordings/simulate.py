"""Recordings made by simulation: the circle in view, the tour of the face, touches at random.

Each trial has its own random streams, spawned from the seed: path, rest posture and each kind of noise. Turning one
kind of noise on changes nothing else, and a trial is the same however many there are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
import xarray as xr

from bodyimage_kin.embodiment import Embodiment
from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.recordings import paths
from bodyimage_kin.recordings.kinematic import follow
from bodyimage_kin.recordings.schema import make_recording

TOUR = ("mouth", "nose", "right_eye", "left_eye", "nose")
"""The paper's sequence of landmarks (section 4.1)."""


def circle(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = False,
    *,
    radius: float = 0.05,
    distance: float = 0.03,
    turns: float = 3.0,
    speed: float = 0.05,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
) -> xr.Dataset:
    """The hand draws circles in front of the face, both ways, in view: what a Jacobian is learned from (Fig. 7).

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own phase and rest posture.
        seed: Same seed, same bits.
        dynamics: A passive arm in a dynamics simulator; False: kinematic motion with the least joint displacement.
        radius: Of the circle [m].
        distance: From touching, along the face's forward direction [m].
        turns: Each way.
        speed: Of the hand [m/s].
        sampling: Time between samples [s].
        rest_spread: Each trial's rest posture is home plus a uniform draw of this half width a joint [rad].
        rest_pull: Rate at which joints return to rest where the hand leaves them free [1/s].
        encoder_noise: Standard deviation of the noise on felt joint values [rad].
        image_noise: Standard deviation of the noise on the felt hand image [m].

    Returns:
        A recording; the module :mod:`bodyimage_kin.recordings.schema` says what is in it.

    Raises:
        InvalidConfig: A setting out of range, ``dynamics=True`` (not available yet), or an embodiment whose eye does
            not see the whole circle.
        Unreachable: The hand cannot follow within the joint limits.
    """
    config = {"kind": "circle", **_settings(locals())}
    _positive(config, "radius", "turns", "speed", "sampling")

    def path(rng: np.random.Generator) -> paths.Path:
        return paths.circle(body, rng, radius=radius, distance=distance, turns=turns, speed=speed, sampling=sampling)

    return _record(body, config, path)


def face_tour(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = False,
    *,
    landmarks: Sequence[str] = TOUR,
    speed: float = 0.05,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    silence: float = 0.0,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
) -> xr.Dataset:
    """The hand visits landmarks of the face, touching it: where velocities are compared (Figs. 8 and 9).

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own rest posture.
        seed: Same seed, same bits.
        dynamics: As in :func:`circle`.
        landmarks: Names of landmarks of the skin, in order.
        speed: Mean speed of the hand between two landmarks [m/s].
        sampling: Time between samples [s].
        rest_spread: As in :func:`circle` [rad].
        rest_pull: As in :func:`circle` [1/s].
        silence: Probability that a touch is not reported.
        encoder_noise: As in :func:`circle` [rad].
        image_noise: As in :func:`circle` [m].

    Raises:
        UnknownName: A landmark that the skin does not have.
        InvalidConfig: As in :func:`circle`, or an eye that sees the hand touch.
        Unreachable: As in :func:`circle`.
    """
    config = {"kind": "face_tour", **_settings(locals())}
    _positive(config, "speed", "sampling")

    def path(rng: np.random.Generator) -> paths.Path:
        return paths.face_tour(body, landmarks=landmarks, speed=speed, sampling=sampling)

    return _record(body, config, path)


def random_touch(
    body: Embodiment,
    trials: int = 1,
    seed: int = 0,
    dynamics: bool = False,
    *,
    duration: float = 800.0,
    speed: float = 0.05,
    reset_interval: float | None = 10.0,
    rest: float = 0.5,
    sampling: float = 0.1,
    rest_spread: float = 0.1,
    rest_pull: float = 0.5,
    silence: float = 0.2,
    encoder_noise: float = 0.0,
    image_noise: float = 0.0,
) -> xr.Dataset:
    """The hand touches the face at random and returns to the reference from time to time: what maps are learned from.

    Args:
        body: The embodiment.
        trials: Number of trials; each has its own targets and rest posture.
        seed: Same seed, same bits.
        dynamics: As in :func:`circle`.
        duration: [s].
        speed: Of the hand [m/s].
        reset_interval: Time between returns to the reference [s]; None: it never returns.
        rest: How long the hand rests at the reference [s].
        sampling: Time between samples [s].
        rest_spread: As in :func:`circle` [rad].
        rest_pull: As in :func:`circle` [1/s].
        silence: Probability that a touch is not reported (0.2 in the paper).
        encoder_noise: As in :func:`circle` [rad].
        image_noise: As in :func:`circle` [m].

    Raises:
        InvalidConfig: As in :func:`face_tour`.
        Unreachable: As in :func:`circle`.
    """
    config = {"kind": "random_touch", **_settings(locals())}
    _positive(config, "duration", "speed", "sampling", "rest")
    if reset_interval is not None:
        _positive(config, "reset_interval")

    def path(rng: np.random.Generator) -> paths.Path:
        return paths.random_touch(
            body, rng, duration=duration, speed=speed, reset_interval=reset_interval, rest=rest, sampling=sampling
        )

    return _record(body, config, path)


def _settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """What the caller asked for, to be kept with the recording."""
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items() if name != "body"
    }


def _positive(config: Mapping[str, Any], *fields: str) -> None:
    for field in fields:
        if not (np.isfinite(config[field]) and config[field] > 0):
            raise InvalidConfig(f"{field}={config[field]!r}: give a positive number")


def _check(config: Mapping[str, Any]) -> None:
    if not isinstance(config["trials"], int) or config["trials"] < 1:
        raise InvalidConfig(f"trials={config['trials']!r}: give a whole number of at least 1")
    if config["dynamics"]:
        raise InvalidConfig("dynamics=True: this version has no dynamics simulator; use dynamics=False")
    for field in ("rest_spread", "rest_pull", "encoder_noise", "image_noise", "silence", "distance"):
        value = config.get(field, 0.0)
        if not (np.isfinite(value) and value >= 0):
            raise InvalidConfig(f"{field}={value!r}: give a number that is not negative")
    if config.get("silence", 0.0) > 1.0:
        raise InvalidConfig(f"silence={config['silence']!r}: give a probability, 0 to 1")


def _record(
    body: Embodiment, config: Mapping[str, Any], path: Callable[[np.random.Generator], paths.Path]
) -> xr.Dataset:
    """Leads the hand along one path a trial and notes what is felt and what is true."""
    _check(config)
    streams = [trial.spawn(5) for trial in np.random.SeedSequence(config["seed"]).spawn(config["trials"])]
    ways = [path(np.random.default_rng(stream[0])) for stream in streams]
    trials, samples = len(ways), max(len(way.centres) for way in ways)
    q = np.full((trials, samples, body.p), np.nan)
    true_q = q.copy()
    at_reference = np.zeros((trials, samples), dtype=bool)
    true_image, position = np.full((trials, samples, body.m), np.nan), np.full((trials, samples, 3), np.nan)
    image = true_image.copy()
    true_taxel = np.full((trials, samples), -1, dtype=np.int64)
    taxel = true_taxel.copy()
    lower, upper = body.felt_robot.lower.numpy(), body.felt_robot.upper.numpy()
    for trial, (way, stream) in enumerate(zip(ways, streams, strict=True)):
        _, for_rest, for_encoders, for_image, for_silence = map(np.random.default_rng, stream)
        spread = config["rest_spread"] * for_rest.uniform(-1.0, 1.0, body.p)
        rest = np.clip(body.felt_home.numpy() + spread, lower, upper)
        here = slice(0, len(way.centres))
        pull = 1.0 - np.exp(-config["rest_pull"] * config["sampling"])
        postures = follow(body, way.centres, rest, float(pull))
        visible = _look(body, config, postures)
        true_q[trial, here] = postures
        at_reference[trial, here] = way.at_reference
        with torch.no_grad():
            tensor = torch.from_numpy(postures)
            true_image[trial, here] = body.hand_image(tensor, on_invisible="nan").numpy()
            position[trial, here] = body.hand_position(tensor).numpy()
            in_skin = body.hand_in_skin(tensor).numpy()
        true_taxel[trial, here] = body.skin.touched(in_skin, body.hand.radius)
        q[trial, here] = postures + config["encoder_noise"] * for_encoders.standard_normal(postures.shape)
        noisy = true_image[trial, here] + config["image_noise"] * for_image.standard_normal((len(postures), body.m))
        image[trial, here] = np.where(visible[:, None], noisy, np.nan)
        silent = for_silence.random(len(postures)) < config.get("silence", 0.0)
        taxel[trial, here] = np.where(silent, -1, true_taxel[trial, here])
    with torch.no_grad():
        reference_image = body.hand_image(body.touch_postures([body.skin.reference]))[0].numpy()
    return make_recording(
        body,
        q=q,
        hand_image=image,
        taxel=taxel,
        at_reference=at_reference,
        reference_image=reference_image,
        true_q=true_q,
        true_hand_image=true_image,
        true_hand_position=position,
        true_taxel=true_taxel,
        sampling=config["sampling"],
        config=config,
    )


def _look(body: Embodiment, config: Mapping[str, Any], postures: np.ndarray) -> np.ndarray:
    """Which samples are seen: all of a circle and none of a touch, or the embodiment is wrong."""
    visible = body.visible(postures).numpy()
    if config["kind"] == "circle" and not visible.all():
        raise InvalidConfig(
            f"embodiment '{body.name}': the eye does not see the hand in {int((~visible).sum())} of {len(visible)} "
            "samples of the circle; move the circle (distance, radius) or mend camera and skin"
        )
    if config["kind"] != "circle" and visible.any():
        raise InvalidConfig(
            f"embodiment '{body.name}': the eye sees the hand in {int(visible.sum())} of {len(visible)} samples while "
            "it touches the skin; mend camera and skin"
        )
    return visible
