"""``bodyimage-kin calibrate``: what is one's own robot really like?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from tyro.conf import Positional, arg

from bodyimage_kin.cli._reading import Reading, heard
from bodyimage_kin.cli.arguments import Flag, Folder, MaybeNumber, Names, finite, print_json
from bodyimage_kin.errors import InvalidConfig

__all__ = ["Calibrate"]


@dataclass(frozen=True, kw_only=True)
class Calibrate(Reading):
    """Find the robot that best explains what was observed of it: where it was drawn wrong, and how sure that is.

    Writes robot.urdf, body.toml, measures.csv and report.html. Exit status 1 when the fit explains nothing.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin calibrate recording.csv --robot my.toml --out found",
        "bodyimage-kin calibrate tracker.csv touches.nc --robot my.toml --free axes offsets hand --out found",
    )

    recordings: Annotated[tuple[Path, ...], Positional, arg(metavar="RECORDING ...", help_behavior_hint="")]
    """Recordings: NetCDF, or tables (CSV, Parquet, MATLAB) with columns q.JOINT and what was observed: hand_image.u,
    hand_image.v; hand_position.x, .y, .z of a tracker; touched."""
    robot: Annotated[str, arg(metavar="NAME|TOML")]
    """Its embodiment: a name, or the path of a TOML file."""
    out: Folder
    """Folder for the results: new, empty, or of an earlier calibration."""
    free: Names = ()
    """What may be off: axes offsets encoders hand camera intrinsics skin; 'auto' frees only what helps; by default
    axes, offsets, hand and skin."""
    axes: MaybeNumber = None
    """How far each axis may be tilted [rad], standard deviation; 0.05 by default."""
    offsets: MaybeNumber = None
    """How far each joint may be shifted [m], standard deviation; 0.005 by default."""
    folds: Annotated[int, arg(metavar="N")] = 5
    """Parts that are hidden in turn to judge, where the recording has no blocks of its own."""
    json: Flag = False
    """The verdict as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin import report
        from bodyimage_kin._files import claim, write_text
        from bodyimage_kin.body.file import load_embodiment
        from bodyimage_kin.calibration import Prior, calibrate
        from bodyimage_kin.recordings import experience

        if not self.recordings:
            raise InvalidConfig("give at least one recording")
        body = load_embodiment(self.robot)
        told = {"axes": self.axes, "offsets": self.offsets}
        prior = Prior(**{name: value for name, value in told.items() if value is not None})
        free = "auto" if self.free == ("auto",) else (self.free or None)
        with heard() as said:
            found = calibrate(
                body,
                [experience(self.read(path, body)) for path in self.recordings],
                prior=prior,
                free=free,  # type: ignore[arg-type]
                folds=self.folds,
            )
        settings = {"robot": self.robot, "recordings": [str(path) for path in self.recordings]}
        folder = claim(self.out, "calibration", settings)
        write_text(folder / "robot.urdf", found.to_urdf())
        if found.skin_moved:
            # A file lays a skin on the link's shapes: where else it was found, no table can say.
            (folder / "body.toml").unlink(missing_ok=True)
            said.append("no body.toml: the skin was found elsewhere than its file lays it")
        else:
            write_text(folder / "body.toml", found.body.to_toml("robot.urdf"))
        write_text(folder / "measures.csv", found.to_csv())
        page = report.write_calibration(found, folder / "report.html", said=said)
        if self.json:
            medians = zip(found.labels, found.units, found.held_out.medians, found.nominal.medians, strict=True)
            print_json(
                {
                    "page": str(page),
                    "explains": found.explains,
                    "verdict": found.verdict,
                    "notes": list(said),
                    "held_out": {
                        name: {"unit": unit, "found": finite(new), "drawn": finite(old)}
                        for name, unit, new, old in medians
                    },
                }
            )
            return int(not found.explains)
        print(found.verdict)
        print(page)
        return int(not found.explains)
