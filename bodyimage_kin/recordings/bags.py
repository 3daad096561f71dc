"""Bags of ROS 1, ROS 2 and MCAP as tables: joint states joined on time with one tracked point.

Only messages of known types are read, by definitions of our own: what a bag says of its types is held against these
and never compiled.
"""

from __future__ import annotations

import re
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording, MissingDependency, UnknownName
from bodyimage_kin.recordings._unpacking import bounded, look_through, unpacked
from bodyimage_kin.recordings.tables import MOST_ROWS, Table

__all__ = ["BAGS", "is_bag", "read_bag"]

BAGS = (".bag", ".mcap", ".db3")
"""Endings of the files that are read as bags; a folder with a ``metadata.yaml`` is one too."""
_JOINTS = "sensor_msgs/msg/JointState"
_POINTS: Mapping[str, Callable[[Any], Any]] = {
    "geometry_msgs/msg/PointStamped": lambda message: message.point,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose.position,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose.position,
    "geometry_msgs/msg/TransformStamped": lambda message: message.transform.translation,
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose.position,
    "visualization_msgs/msg/Marker": lambda message: message.pose.position,
}
"""Type of a message -> the point it says."""
_TREES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_OBSERVED = ("hand_position", "hand_image")
_AXES = "xyz"
_Stamped: TypeAlias = list[tuple[int, Any]]
"""Times [ns] and what was there."""


def is_bag(path: Path) -> bool:
    """Whether a path names a bag."""
    return path.suffix.lower() in BAGS or (path / "metadata.yaml").is_file()


def read_bag(
    path: Path,
    topics: Mapping[str, Any] | None = None,
    *,
    joints: Sequence[str] | None = None,
    width: int | None = None,
    join_within: float = 0.1,
    most_rows: int = MOST_ROWS,
) -> tuple[Table, dict[str, Any]]:
    """A row for each observation of the tracked point, with the joints interpolated to its time.

    Args:
        path: The bag: a file, or the folder of a ROS 2 one.
        topics: ``"q"`` -> topic of joint states, and ``"hand_position"`` or ``"hand_image"`` -> topic of the tracked
            point; of transforms or markers the one in brackets, ``"/tf[wrist_marker]"``. What is not named is found
            where there is one alone.
        joints: Those to take; None: all that are in the joint states.
        width: Coordinates of a hand image, the first of the point's; None: two.
        join_within: Joint states on both sides of an observation must be this near in time [s].
        most_rows: More messages of a topic are refused.

    Returns:
        The table, and the columns of each variable of the recording.

    Raises:
        MissingDependency: Without rosbags.
        UnknownName: A topic or joint that the bag does not have.
        InvalidConfig: Variables that no bag is read for.
        InvalidRecording: A bag that is damaged, unpacks to more than any recorder packs together, has messages of other
            types, or in which nothing is joined.
    """
    try:
        import rosbags  # noqa: F401
    except ImportError:
        raise MissingDependency("a bag needs rosbags; pip install 'bodyimage-kin[bags]'") from None
    for variable in topics or {}:
        if variable not in ("q", *_OBSERVED):
            raise InvalidConfig(f"columns: of a bag {variable!r} is not read; give topics of q, and {_either()}")
    try:
        chunks = frozenset() if path.suffix.lower() == ".bag" else look_through(path)
        bag = _Bag(path, most_rows)
        with bag.reader:
            object.__setattr__(bag, "packed", bounded(bag.reader, path, chunks))
            where, observed = _chosen(bag, {name: str(topic) for name, topic in (topics or {}).items()})
            states, points = bag.joint_states(where["q"]), bag.points(where[observed])
    except (InvalidRecording, UnknownName, InvalidConfig):
        raise
    except Exception as problem:  # whatever a damaged bag makes of its reader
        said = (str(problem).splitlines() or [type(problem).__name__])[0][:200]
        raise InvalidRecording(f"'{path.name}' is no bag that can be read: {said}") from None
    return _joined(path.name, where, observed, states, points, joints, width, join_within)


@dataclass(frozen=True, eq=False)
class _Bag:
    """An open bag; ``packed``: messages come as they are packed."""

    path: Path
    most_rows: int
    packed: bool = field(init=False, default=False)
    reader: Any = field(init=False)
    stores: tuple[Any, ...] = field(init=False)

    def __post_init__(self) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        reader = rosbag1.Reader(self.path) if self.first else rosbag2.Reader(self.path)
        stores = [Stores.ROS1_NOETIC] if self.first else [Stores.LATEST, Stores.ROS2_FOXY]
        made = [get_typestore(one) for one in stores]
        for store in made:
            for kind in _TREES:
                if kind not in store.fielddefs:
                    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
        object.__setattr__(self, "reader", reader)
        object.__setattr__(self, "stores", tuple(made))

    @property
    def first(self) -> bool:
        """Whether it is of ROS 1."""
        return self.path.suffix.lower() == ".bag"

    @property
    def kinds(self) -> dict[str, str]:
        """Topic -> type of its messages."""
        return {connection.topic: connection.msgtype for connection in self.reader.connections}

    def joint_states(self, topic: str) -> _Stamped:
        """Time and joint -> value of each message."""
        found: _Stamped = []
        for time, message, _ in self._messages(topic):
            if len(message.name) != len(message.position):
                if len(message.position):
                    raise InvalidRecording(
                        f"'{self.path.name}', topic '{topic}': a message has {len(message.name)} names and "
                        f"{len(message.position)} positions"
                    )
                continue
            found.append((time, dict(zip(message.name, map(float, message.position), strict=True))))
        return found

    def points(self, topic: str) -> _Stamped:
        """Time and (3,) of each message; of transforms and markers those of the name in brackets."""
        plain, name = _name_in_brackets(topic)
        found, others, frames = _Stamped(), set[str](), set[str]()
        for time, message, kind in self._messages(plain):
            if kind in _TREES:
                each = [(one, one.child_frame_id, one.transform.translation) for one in message.transforms]
            else:
                called = f"{message.id}" if kind.endswith("/Marker") else ""
                each = [(message, called, _POINTS[kind](message))]
            for one, called, point in each:
                called = called.lstrip("/")
                if name is None or called == name:
                    stamp = _stamp(one.header) or time
                    frames.add(one.header.frame_id)
                    found.append((stamp, (point.x, point.y, point.z)))
                if called:
                    others.add(called)
        if name is None and len(others) > 1:
            raise InvalidRecording(
                f"'{self.path.name}': topic '{plain}' tells of {len(others)} things; say which: "
                f"{', '.join(f'{plain}[{one}]' for one in sorted(others)[:5])}"
            )
        if name is not None and not found:
            raise UnknownName(f"thing that topic '{plain}' tells of", name, sorted(others))
        if len(frames) > 1:
            raise InvalidRecording(
                f"'{self.path.name}': points of topic '{topic}' are told in several frames "
                f"({', '.join(sorted(frames)[:4])}); record them in one"
            )
        return found

    def _messages(self, topic: str) -> Iterator[tuple[int, Any, str]]:
        """Time [ns], message and type of each message of a topic."""
        connections = [one for one in self.reader.connections if one.topic == topic]
        if (count := sum(one.msgcount for one in connections)) > self.most_rows:
            raise InvalidRecording(
                f"'{self.path.name}', topic '{topic}': {count:,} messages, more than {self.most_rows:,}; cut the bag"
            )
        stores = {one.id: self._store(one) for one in connections}
        for connection, time, data in self.reader.messages(connections):
            raw = unpacked(data, self.path.name) if self.packed else data
            for store in stores[connection.id]:
                message = self._read(store, raw, connection.msgtype)
                if message is not None:
                    break
            else:
                raise InvalidRecording(
                    f"'{self.path.name}', topic '{topic}': a message is no {connection.msgtype} as it is known here"
                )
            yield _stamp(getattr(message, "header", None)) or time, message, connection.msgtype

    def _read(self, store: Any, raw: bytes, kind: str) -> Any:
        """A message; None where its bytes are of another definition."""
        read = store.deserialize_ros1 if self.first else store.deserialize_cdr
        try:
            return read(raw, kind)
        except Exception:
            return None

    def _store(self, connection: Any) -> list[Any]:
        """The definitions by which a topic's messages may be read: the one it was written with, where it says so."""
        kind, digest = connection.msgtype, connection.digest
        if not digest:
            return list(self.stores)
        same = [
            one
            for one in self.stores
            if digest == (one.generate_msgdef(kind)[1] if self.first else one.hash_rihs01(kind))
        ]
        if not same:
            raise InvalidRecording(
                f"'{self.path.name}', topic '{connection.topic}': another version of {kind} than those known here; "
                "convert the bag"
            )
        return same


def _name_in_brackets(topic: str) -> tuple[str, str | None]:
    found = re.fullmatch(r"(.+)\[(.+)\]", topic)
    return (topic, None) if found is None else (found[1], found[2].lstrip("/"))


def _stamp(header: Any) -> int:
    """Time of a header [ns]; 0 where it says none."""
    return 0 if header is None else int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _either() -> str:
    return " or ".join(_OBSERVED)


def _chosen(bag: _Bag, topics: Mapping[str, str]) -> tuple[dict[str, str], str]:
    """Variable -> topic, what is not named being the only one of its kind; and the variable that is observed."""
    kinds = bag.kinds
    told = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(kinds.items())) or "no topic"
    observed = [name for name in _OBSERVED if name in topics]
    if len(observed) > 1:
        raise InvalidConfig(f"columns: of a bag one of {_either()} is read at a time")
    fitting = {
        "q": [topic for topic, kind in kinds.items() if kind == _JOINTS],
        "observed": [topic for topic, kind in kinds.items() if kind in _POINTS or kind in _TREES],
    }
    found: dict[str, str] = {}
    for variable, role in (("q", "q"), (observed[0] if observed else _OBSERVED[0], "observed")):
        if variable in topics:
            plain = _name_in_brackets(topics[variable])[0]
            if plain not in kinds:
                raise UnknownName(f"topic of '{bag.path.name}'", plain, sorted(kinds))
            if plain not in fitting[role]:
                wanted = _JOINTS if role == "q" else f"one of {', '.join((*_POINTS, *_TREES))}"
                raise InvalidRecording(
                    f"'{bag.path.name}': topic '{plain}' has {kinds[plain]}; {variable} needs {wanted}"
                )
            found[variable] = topics[variable]
        elif len(fitting[role]) == 1:
            found[variable] = fitting[role][0]
        else:
            raise InvalidRecording(
                f"'{bag.path.name}' has {told}; name the topic of {variable}: columns={{{variable!r}: ...}}"
            )
    return found, next(name for name in found if name != "q")


# Joined on time ------------------------------------------------------------------------------------------------------


def _joined(
    name: str,
    where: Mapping[str, str],
    observed: str,
    states: _Stamped,
    points: _Stamped,
    joints: Sequence[str] | None,
    width: int | None,
    within: float,
) -> tuple[Table, dict[str, Any]]:
    values: dict[str, _Stamped] = defaultdict(list)
    for time, named in states:
        for joint, value in named.items():
            values[joint].append((time, value))
    for joint in joints or ():
        if joint not in values:
            raise UnknownName(f"joint in topic '{where['q']}'", joint, values)
    wanted = list(values) if joints is None else list(joints)
    if not wanted or not points:
        topic = where[observed] if wanted else where["q"]
        raise InvalidRecording(f"'{name}': topic '{topic}' says nothing")
    times, place = _in_order(points)
    origin = times[0]
    columns: dict[str, np.ndarray] = {"time": (times - origin) * 1e-9}
    near = np.ones(len(times), dtype=bool)
    for joint in wanted:
        columns[f"q.{joint}"], is_near = _at(times, values[joint], within)
        near &= is_near
    if not near.any():
        off = (np.median([time for time, _ in states]) - np.median(times)) * 1e-9
        raise InvalidRecording(
            f"'{name}': no observation of '{where[observed]}' has joint states within {within:g} s on both sides (the "
            f"clocks are {off:.3g} s apart, medians); set the clocks, or give a larger join_within"
        )
    if not near.all():
        message = f"'{name}': {int((~near).sum())} of {len(near)} observations have no joint states within {within:g} s"
        warnings.warn(f"{message} on both sides; they are left out", DataWarning, stacklevel=4)
    count = 3 if observed == "hand_position" else (width or 2)
    for axis, label in enumerate(_AXES[:count]):
        columns[f"{observed}.{label}"] = np.array([points[index][1][axis] for index in place], dtype=np.float64)
    kept = {column: one[near] for column, one in columns.items()}
    table = Table(name, kept, "observation", (np.flatnonzero(near) + 1).tolist())
    return table, {
        "q": {joint: f"q.{joint}" for joint in wanted},
        observed: [f"{observed}.{label}" for label in _AXES[:count]],
        "time": "time",
    }


def _in_order(stamped: _Stamped) -> tuple[Int[np.ndarray, "kept"], Int[np.ndarray, "kept"]]:
    """Times that go forward, and which entry each is of: the first of those that say the same time."""
    times, first = np.unique(np.array([time for time, _ in stamped], dtype=np.int64), return_index=True)
    return times, first


def _at(
    times: Int[np.ndarray, "rows"], stamped: _Stamped, within: float
) -> tuple[Float[np.ndarray, "rows"], Bool[np.ndarray, "rows"]]:
    """Values between those before and after each time, and whether both are near enough."""
    known, place = _in_order(stamped)
    values = np.array([stamped[index][1] for index in place])
    after = np.searchsorted(known, times).clip(0, len(known) - 1)
    before = np.where(known[after] == times, after, (after - 1).clip(0))
    gap = np.maximum(times - known[before], known[after] - times)
    outside = (times < known[0]) | (times > known[-1])
    span = np.maximum(known[after] - known[before], 1)
    share = (times - known[before]) / span
    return values[before] + share * (values[after] - values[before]), (gap <= within * 1e9) & ~outside
