"""The commands of recordings: ``simulate``, ``import`` and ``fit``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from tyro.conf import Positional, arg

from bodyimage_kin.cli.arguments import (
    Command,
    File,
    Flag,
    Folder,
    MaybeEmbodiment,
    MaybeFile,
    MaybeName,
    MaybeNumber,
    Names,
    Seed,
    free,
    pairs,
    print_json,
    read_toml,
    setting,
)
from bodyimage_kin.errors import InvalidConfig

if TYPE_CHECKING:
    import xarray as xr

    from bodyimage_kin.body import Embodiment
    from bodyimage_kin.robot import Robot

__all__ = ["Fit", "Import", "Simulate"]

_Pairs = Annotated[tuple[str, ...], arg(metavar="NAME=VALUE ...", help_behavior_hint="")]
_Deviation = Annotated[float, arg(metavar="X")]


@dataclass(frozen=True)
class Simulate(Command):
    """Record what a body feels and sees while its hand moves, beside the truth, and write it as NetCDF."""

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin simulate Circle --out circle.nc",
        "bodyimage-kin simulate RandomTouch --set duration=80 reset_interval=5 --kinematic --out touch.nc",
        "bodyimage-kin simulate Circle --embodiment my.toml --torque .1 --encoder 1e-3 --image .3 --out noisy.nc",
    )

    motion: Annotated[str, Positional, arg(metavar="MOTION")]
    """What the hand does: Circle, Circles, Lissajous, Babbling, FaceTour, RandomTouch, or package.module:Class."""
    out: File
    """The recording's file, NetCDF."""
    embodiment: Annotated[str, arg(metavar="NAME|TOML")] = "infant"
    """Name of an embodiment, or path of a TOML file."""
    set: _Pairs = ()
    """Settings of the motion: radius=.04, landmarks='["mouth", "nose"]'."""
    seed: Seed = 0
    """Same seed, same bits."""
    trials: Annotated[int, arg(metavar="N")] = 1
    """Number of trials."""
    kinematic: Flag = False
    """Lead the hand with the least joint displacement, instead of dragging a passive arm."""
    torque: _Deviation = 0.0
    """Standard deviation of a random torque on the hand [N m]."""
    encoder: _Deviation = 0.0
    """Standard deviation of what is felt of a joint [rad or m]."""
    image: _Deviation = 0.0
    """Standard deviation of each coordinate of the hand image [its unit]."""
    blind_touch: Flag = False
    """Images of the hand while it touches count as unseen, whatever the eye sees then."""
    overwrite: Flag = False
    """Replace a file that is there."""
    json: Flag = False
    """What was recorded as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.body.file import load_embodiment
        from bodyimage_kin.recordings import Noise, simulate, write_recording
        from bodyimage_kin.study.specs import MOTION

        free(self.out, self.overwrite)
        settings = {name: setting(value) for name, value in pairs("--set", self.set).items()}
        motion = MOTION.build({self.motion: settings})
        noise = Noise(torque=self.torque, encoder=self.encoder, image=self.image)
        body = load_embodiment(self.embodiment)
        recording = simulate(
            body, motion, self.seed, self.trials, not self.kinematic, noise, touch_seen=not self.blind_touch
        )
        write_recording(recording, self.out)
        _say(recording, self.out, self.json)
        return 0


_TABLES = (
    *("columns", "units", "joints", "order", "size", "unseen", "where", "gap", "sampling", "variable", "decimal"),
    "join_within",
)


@dataclass(frozen=True)
class Import(Command):
    """Turn a table of postures and observations (CSV, Parquet, MATLAB), or a bag, into a recording, and check it.

    What people get wrong in tables is said in one line with row and column: degrees for radians, millimetres for
    metres, a clock that runs back, images outside the sensor.
    """

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin import table.csv --robot my.toml --out lab.nc",
        "bodyimage-kin import poses.csv --columns 'q=arm.*' hand_image=u,v time=stamp --units q=deg --out lab.nc",
        "bodyimage-kin import poses.mat --settings lab.toml --order scattered --out lab.nc",
        "bodyimage-kin import run.mcap --columns q=/joint_states 'hand_position=/tf[marker_7]' --out lab.nc",
    )

    table: Annotated[Path, Positional, arg(metavar="TABLE")]
    """The table: .csv, .tsv, .txt, .dat, .parquet, .mat; a bag: .bag, .mcap, .db3 or its folder."""
    out: File
    """The recording's file, NetCDF."""
    robot: MaybeEmbodiment = None
    """Whose joints these are: a URDF, an embodiment's TOML file or name; names, limits and units are checked by it."""
    columns: _Pairs = ()
    """q=shoulder,elbow or q='arm.*' or q=JOINT:COLUMN,...; hand_image=u,v; hand_position=x,y,z; touched=t; time=stamp;
    likewise trial, block, repeat. Numbers are columns by position, from 0. Without: columns named so, or as joints.
    Of a bag: topics."""
    units: _Pairs = ()
    """Units in the file: q=deg, hand_position=mm, time=ms. Else radians, metres, seconds, pixels."""
    joints: Names = ()
    """Names of the joints, in the order of the columns of q."""
    order: Annotated[Literal["stream", "scattered"] | None, arg(metavar="stream|scattered", help_behavior_hint="")] = (
        None
    )
    """Rows one after the other in time, or postures in no order; a column of time says the first."""
    size: Annotated[tuple[int, int] | None, arg(metavar="WIDTH HEIGHT", help_behavior_hint="")] = None
    """Of the image [px], to check it."""
    unseen: Annotated[tuple[float, ...], arg(metavar="X ...", help_behavior_hint="")] = ()
    """Numbers that stand for an unseen hand, such as -1; empty cells always do."""
    where: _Pairs = ()
    """Only rows in which a column has this value: camera=1."""
    gap: MaybeNumber = None
    """A pause of more than this begins a new trial [s]."""
    sampling: MaybeNumber = None
    """Put the samples on a clock of this step [s]; by default they stay where they are."""
    variable: MaybeName = None
    """Name of the variable in a MATLAB file that holds several."""
    decimal: Annotated[str | None, arg(metavar=".|,", help_behavior_hint="")] = None
    """What stands before the decimals in a text; a point."""
    join_within: MaybeNumber = None
    """Joint states on both sides of an observation in a bag must be this near in time [s]; 0.1."""
    settings: MaybeFile = None
    """TOML file with any of these (columns, units, order ...); what is given here goes before it."""
    overwrite: Flag = False
    """Replace a file that is there."""
    json: Flag = False
    """What was read as JSON, for a machine."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.recordings import read_recording, write_recording

        free(self.out, self.overwrite)
        options = {} if self.settings is None else read_toml(self.settings, ("robot", *_TABLES))
        options |= {name: value for name, value in self._given().items() if value not in (None, (), {})}
        robot = options.pop("robot", None)
        recording = read_recording(self.table, robot=None if robot is None else _robot(str(robot)), **options)
        write_recording(recording, self.out)
        _say(recording, self.out, self.json)
        return 0

    def _given(self) -> dict[str, Any]:
        """What the command line says of tables."""
        return {
            "robot": self.robot,
            "columns": _columns(pairs("--columns", self.columns)),
            "units": pairs("--units", self.units),
            "where": {name: setting(value) for name, value in pairs("--where", self.where).items()},
            **{name: getattr(self, name) for name in _TABLES if name not in ("columns", "units", "where")},
        }


@dataclass(frozen=True)
class Fit(Command):
    """Learn a Jacobian from a recording and save it."""

    EXAMPLES: ClassVar[tuple[str, ...]] = (
        "bodyimage-kin fit RationalTrig circle.nc --out learned",
        "bodyimage-kin fit SelfCalibration lab.nc --embodiment my.toml --out learned",
    )

    estimator: Annotated[str, Positional, arg(metavar="ESTIMATOR")]
    """Name of an estimator, or package.module:Class."""
    recording: Annotated[Path, Positional, arg(metavar="RECORDING")]
    """The recording, NetCDF."""
    out: Folder
    """Folder for the learned Jacobian."""
    embodiment: MaybeEmbodiment = None
    """For estimators that know the body."""
    seed: Seed = 0
    """Of whatever is drawn at random."""

    def __call__(self) -> int:
        """Runs it."""
        from bodyimage_kin.cli import study as commands

        return commands.fit_command(
            self.estimator, self.recording, self.out, embodiment=self.embodiment, seed=self.seed
        )


def _robot(place: str) -> Robot | Embodiment:
    """A robot from its URDF, or an embodiment by name or from its TOML file."""
    from bodyimage_kin.body.file import load_embodiment
    from bodyimage_kin.robot import Robot

    if Path(place).suffix.lower() in (".urdf", ".xml"):
        return Robot.from_urdf(place)
    return load_embodiment(place)


def _columns(given: Mapping[str, str]) -> dict[str, Any]:
    """Columns as :func:`bodyimage_kin.read_recording` takes them."""
    parts = {variable: [one.strip() for one in text.split(",")] for variable, text in given.items()}
    for variable, names in parts.items():
        if not all(names):
            raise InvalidConfig(f"--columns {variable}={given[variable]!r}: give names with commas between them")
    by_position = all(_is_place(name.rpartition(":")[2]) for names in parts.values() for name in names)
    found: dict[str, Any] = {}
    for variable, names in parts.items():
        if all(":" in name for name in names):
            labelled = (name.partition(":")[::2] for name in names)
            found[variable] = {joint: int(name) if by_position else name for joint, name in labelled}
        else:
            columns = [int(name) if by_position else name for name in names]
            found[variable] = columns[0] if len(columns) == 1 else columns
    return found


def _is_place(text: str) -> bool:
    return text.isascii() and text.isdigit()


def _say(recording: xr.Dataset, path: Path, as_json: bool) -> None:
    """What is in a recording, in a few lines or as JSON."""
    told = _told(recording)
    if as_json:
        print_json({"recording": str(path), **told})
        return
    print(f"{path}: {told['order']}, trials {told['trials']}, samples {told['samples']}")
    print(f"joints [{told['unit_of_joints']}]: {', '.join(told['joints'])}")
    for name, one in told["observations"].items():
        unit = f" [{one['unit']}]" if one["unit"] else ""
        print(f"{name}{unit}: in {one['samples']} of {told['samples']} samples")


def _told(recording: xr.Dataset) -> dict[str, Any]:
    import numpy as np

    from bodyimage_kin.recordings import joint_names
    from bodyimage_kin.recordings.schema import OBSERVATIONS

    observations = {}
    for name in OBSERVATIONS:
        if name in recording:
            values = recording[name].values
            there = (values >= 0).any(-1) if name == "touched" else np.isfinite(values).all(-1)
            observations[name] = {"samples": int(there.sum()), "unit": str(recording[name].attrs.get("units", ""))}
    return {
        "order": str(recording.attrs.get("order", "stream")),
        "trials": recording.sizes["trial"],
        "samples": int(np.isfinite(recording["q"].values).all(-1).sum()),
        "joints": list(joint_names(recording)),
        "unit_of_joints": str(recording["q"].attrs.get("units", "rad")),
        "observations": observations,
        "attributes": {
            name: value if isinstance(value, str | int | float) else json.dumps(value)
            for name, value in recording.attrs.items()
        },
    }
