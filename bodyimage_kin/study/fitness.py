"""What cannot work with a study's bodies, said before anything is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bodyimage_kin.body import check_embodiment
from bodyimage_kin.body.check import refuse_errors
from bodyimage_kin.body.embodiment import Embodiment
from bodyimage_kin.study.specs import Table

__all__ = ["refuse_unfit"]


def refuse_unfit(bodies: Mapping[str, Embodiment | None], recordings: Mapping[str, Table]) -> None:
    """Refuses bodies of which no recording of the study can say anything.

    Args:
        bodies: Name -> embodiment; None: it is not known.
        recordings: Name -> settings of a :class:`bodyimage_kin.study.Simulation`.

    Raises:
        InvalidConfig: Felt joints that never move the hand as the eye sees it, an eye that never sees it, or a circle
            of the study that the hand does not reach, or the eye does not see; tells what to mend.
        ManyMistakes: Several of these.
    """
    circles = list(dict.fromkeys(_circles(recordings)))
    for body in bodies.values():
        if body is None:
            continue
        refuse_errors(body, [one for one in check_embodiment(body) if one.about in ("joints", "eye")])
        for radius, distance in circles:
            found = check_embodiment(body, radius=radius, distance=distance)
            refuse_errors(body, [one for one in found if one.about == "circle"])


def _circles(recordings: Mapping[str, Table]) -> Iterator[tuple[float, float]]:
    """Radius and distance of each circle that is simulated [m]."""
    for settings in recordings.values():
        training = settings["training"]
        for motion in training if isinstance(training, list) else [training]:
            circle = motion.get("Circle") if isinstance(motion, Mapping) else None
            if circle is not None:
                yield float(circle["radius"]), float(circle["distance"])
