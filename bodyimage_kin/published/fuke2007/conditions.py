"""What is varied: how the arm moves, and how long the network learns.

The paper changes noise and learning steps at once (Table 1). Here both are crossed, so that each has its own effect;
the paper's own two pairs are marked.
"""

from __future__ import annotations

from dataclasses import dataclass

from bodyimage_kin.errors import InvalidConfig
from bodyimage_kin.estimators import PaperMLP
from bodyimage_kin.recordings import Noise

PROBES = ("on_circle", "in_front", "on_face")
"""Posture sets that leave what was seen step by step: seen postures, taxels 3 cm off, taxels touched."""
PARTS = ("scale", "mean_excited", "mean_unexcited", "variation")
"""What a squared Jacobian error is the sum of (:class:`bodyimage_kin.metrics.Attribution`)."""
DIRECT = "direct"
"""The map learned from direct sight of the hand: no Jacobian in it."""


@dataclass(frozen=True)
class Motion:
    """How the arm is moved in all three recordings.

    Attributes:
        name: Its name in files.
        dynamics: A passive arm in a dynamics simulator, or kinematic motion with the least joint displacement.
        torque_noise: Standard deviation of the random torque on the hand [N m].
    """

    name: str
    dynamics: bool
    torque_noise: float = 0.0

    @property
    def noise(self) -> Noise:
        """What disturbs the arm."""
        return Noise(torque=self.torque_noise)


@dataclass(frozen=True)
class Condition:
    """One way to run the experiment.

    Attributes:
        name: Its name in results.
        motion: How the arm is moved.
        steps: Descent steps of the paper's network.
        paper: Whether the paper has this pair of noise and steps.
    """

    name: str
    motion: Motion
    steps: int
    paper: bool = False

    @property
    def network(self) -> PaperMLP:
        """The paper's network as it learns here."""
        return PaperMLP(hidden=10, learning_rate=0.2, steps=self.steps)


MOTIONS = (
    Motion("kinematic", dynamics=False),
    Motion("noise_free", dynamics=True),
    Motion("noisy", dynamics=True, torque_noise=0.1),
)
_KINEMATIC, _NOISE_FREE, _NOISY = MOTIONS
CONDITIONS = (
    Condition("kinematic", _KINEMATIC, steps=200),
    Condition("noise_free_200", _NOISE_FREE, steps=200, paper=True),
    Condition("noise_free_500", _NOISE_FREE, steps=500),
    Condition("noisy_200", _NOISY, steps=200),
    Condition("noisy_500", _NOISY, steps=500, paper=True),
)


@dataclass(frozen=True)
class Settings:
    """What a run is asked for.

    Attributes:
        embodiment: Name, or path of a TOML file.
        seeds: Number of recordings of each motion.
        quick: A tenth of the touching time, for a first look.
        backend: Kinematics backend; None: the default.
        encoder_noise: Standard deviation of the noise on felt joint values, in every motion [rad].
        image_noise: Standard deviation of the noise on the felt hand image, in every motion [m].
    """

    embodiment: str = "infant"
    seeds: int = 10
    quick: bool = False
    backend: str | None = None
    encoder_noise: float = 0.0
    image_noise: float = 0.0

    def __post_init__(self) -> None:
        if self.seeds < 1:
            raise InvalidConfig(f"seeds={self.seeds}: give a whole number of at least 1")

    @property
    def touch_duration(self) -> float:
        """How long the face is touched [s]."""
        return 80.0 if self.quick else 800.0
