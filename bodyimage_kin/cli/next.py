"""``bodyimage-kin next``: where should one's own robot look next?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from tyro.conf import arg

from bodyimage_kin.cli._reading import Reading, heard
from bodyimage_kin.cli.arguments import Flag, Folder, MaybeFile, MaybeNumber, Seed, print_json

__all__ = ["Next"]


@dataclass(frozen=True, kw_only=True)
class Next(Reading):
    """Choose the postures whose images tell most of what the robot cannot see; works before anything was seen.

    Writes postures.csv and report.html.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin next --robot my.toml --count 10 --out next",
        "bodyimage-kin next --robot my.toml --seen recording.csv --units q=deg --noise .5 --out next",
    )

    robot: Annotated[str, arg(metavar="NAME|TOML")]
    """Its embodiment: a name, or the path of a TOML file."""
    seen: MaybeFile = None
    """What was seen already: a recording, NetCDF or a table."""
    count: Annotated[int, arg(metavar="N")] = 10
    """How many postures."""
    at: Annotated[Literal["face", "joint_space"] | None, arg(metavar="face|joint_space", help_behavior_hint="")] = None
    """Where it wants to know its map: on its skin, or anywhere; by default on the skin, if it has one."""
    axes: MaybeNumber = None
    """How far each axis may be tilted [rad], standard deviation; 0.05 by default."""
    offsets: MaybeNumber = None
    """How far each joint may be shifted [m], standard deviation; 0.005 by default."""
    noise: MaybeNumber = None
    """Standard deviation of the image, in its unit; 0.2 mm by default on a virtual screen, to be given otherwise."""
    apart: Annotated[float, arg(metavar="X")] = 1e-3
    """Least distance of any two postures, in their farthest joint [rad or m]: the noise of the encoders."""
    seed: Seed = 0
    """Of the candidates that are drawn."""
    out: Folder = Path("next")
    """Folder for the results."""
    json: Flag = False
    """The postures as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin import report
        from bodyimage_kin._files import claim, write_text
        from bodyimage_kin.body.file import load_embodiment
        from bodyimage_kin.calibration import Prior, next_postures
        from bodyimage_kin.metrics.probes import Face, JointSpace
        from bodyimage_kin.recordings import align, experience

        body = load_embodiment(self.robot)
        at = self.at or ("face" if body.skin is not None else "joint_space")
        told = {"axes": self.axes, "offsets": self.offsets}
        with heard() as said:
            seen = None if self.seen is None else experience(align(self.read(self.seen, body), body))
            chosen = next_postures(
                body,
                seen,
                Face() if at == "face" else JointSpace(),
                self.count,
                prior=Prior(**{name: value for name, value in told.items() if value is not None}),
                noise=self.noise,
                apart=self.apart,
                seed=self.seed,
            )
        folder = claim(self.out, "next postures", {"robot": self.robot, "count": self.count})
        write_text(folder / "postures.csv", chosen.to_csv())
        names = ["on_face" if at == "face" else "joint_space"]
        page = report.write_next_postures(chosen, body, names, folder / "report.html", said=said)
        if self.json:
            expected = [float(one) for one in chosen.predicted_error]
            postures = chosen.q.tolist()
            print_json({"page": str(page), "joints": list(body.joints), "q": postures, "expected_error": expected})
            return 0
        first, last = chosen.predicted_error[0], chosen.predicted_error[-1]
        print(f"expected error {100 * first:.3g} % -> {100 * last:.3g} % after {len(chosen.q)} postures")
        print(page)
        return 0
