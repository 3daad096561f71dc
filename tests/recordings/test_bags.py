"""Bags: joint states and one tracked point, joined on time; written here by the library that reads them."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest

import bodyimage_kin as bk
from bodyimage_kin.errors import DataWarning, InvalidConfig, InvalidRecording, UnknownName
from bodyimage_kin.recordings import _unpacking

rosbags = pytest.importorskip("rosbags", reason="bags need the extra [bags]")

from rosbags import rosbag1, rosbag2  # noqa: E402
from rosbags.rosbag2.reader import zstd  # noqa: E402
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

START = 1_700_000_000.0
JOINTS = ("elbow", "wrist")
KINDS = ("ros1.bag", "ros2", "mcap", "file.mcap")


def elbow(t):
    return 0.5 * np.sin(t)


def wrist(t):
    return 0.3 * t


def place(t):
    return np.array([0.4 + 0.1 * np.cos(t), 0.2 * np.sin(t), 0.3 + 0.01 * t])


class Writer:
    """A bag of one kind, with the messages of its distribution."""

    def __init__(self, folder, kind, packed=""):
        self.first = kind.endswith(".bag")
        self.store = get_typestore(Stores.ROS1_NOETIC if self.first else Stores.ROS2_HUMBLE)
        if self.first:
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            )
        self.path = folder / kind.replace("file.mcap", "file")
        if self.first:
            self.writer = rosbag1.Writer(self.path)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if "mcap" in kind else rosbag2.StoragePlugin.SQLITE3
            self.writer = rosbag2.Writer(self.path, version=9, storage_plugin=plugin)
        if self.first and packed:
            self.writer.set_compression(getattr(rosbag1.Writer.CompressionFormat, packed))
        elif packed:
            formats = rosbag2.Writer if hasattr(rosbag2.Writer, "CompressionMode") else rosbag2
            self.writer.set_compression(getattr(formats.CompressionMode, packed), formats.CompressionFormat.ZSTD)
        self.kind, self.connections = kind, {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *problem):
        self.writer.close()
        if self.kind == "file.mcap":
            self.path = next(self.path.glob("*.mcap"))

    def make(self, kind, /, **fields):
        return self.store.types[kind](**fields)

    def header(self, t, frame="world"):
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(t), nanosec=round((t % 1) * 1e9))
        more = {"seq": 0} if self.first else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def write(self, topic, name, t, message):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, name, typestore=self.store)
        data = self.store.serialize_ros1(message, name) if self.first else self.store.serialize_cdr(message, name)
        # The bag's own clock is late: what counts is the stamp in the header.
        self.writer.write(self.connections[topic], int((t + 0.5) * 1e9), data)

    def joints(self, t, topic="/joint_states", **values):
        none = np.zeros(0)
        message = self.make(
            "sensor_msgs/msg/JointState", header=self.header(t), name=list(values),
            position=np.array(list(values.values()), dtype=float), velocity=none, effort=none,
        )  # fmt: skip
        self.write(topic, "sensor_msgs/msg/JointState", t, message)

    def point(self, t, point, topic="/marker", frame="camera"):
        point = self.make("geometry_msgs/msg/Point", x=point[0], y=point[1], z=point[2])
        message = self.make("geometry_msgs/msg/PointStamped", header=self.header(t, frame), point=point)
        self.write(topic, "geometry_msgs/msg/PointStamped", t, message)

    def transforms(self, t, points, topic="/tf"):
        each = []
        for child, point in points.items():
            rotation = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
            moved = self.make("geometry_msgs/msg/Vector3", x=point[0], y=point[1], z=point[2])
            transform = self.make("geometry_msgs/msg/Transform", translation=moved, rotation=rotation)
            each.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(t),
                    child_frame_id=child,
                    transform=transform,
                )
            )
        self.write(topic, "tf2_msgs/msg/TFMessage", t, self.make("tf2_msgs/msg/TFMessage", transforms=each))


def plain(folder, kind="ros2", **changes):
    """Joint states at 50 Hz, of the gripper apart and of two joints; a marker seen at 9 Hz."""
    with Writer(folder, kind, changes.get("packed", "")) as bag:
        for t in START + 0.02 * np.arange(100):
            bag.joints(t, elbow=elbow(t - START), wrist=wrist(t - START))
            bag.joints(t + 0.003, gripper=0.01)
        for t in changes.get("seen", START + 0.05 + 0.11 * np.arange(17)):
            bag.point(t, place(t - START), frame=changes.get("frame", lambda t: "camera")(t))
    return bag.path


@pytest.mark.parametrize("kind", KINDS)
def test_joints_are_interpolated_to_the_times_of_a_point(tmp_path, kind):
    rec = bk.read_recording(plain(tmp_path, kind), joints=JOINTS)
    assert rec.attrs["order"] == "stream"
    assert rec["joint"].values.tolist() == list(JOINTS)
    assert rec["hand_position"].attrs["units"] == "m"
    t = 0.05 + 0.11 * np.arange(17)
    np.testing.assert_allclose(rec["time"], t - t[0], atol=1e-6)
    np.testing.assert_allclose(rec["hand_position"].values[0], np.stack([place(one) for one in t]), atol=1e-6)
    # Between samples 20 ms apart, a line is off by at most 0.5 * .02^2 / 8.
    np.testing.assert_allclose(rec["q"].values[0, :, 0], elbow(t), atol=2.5e-5)
    np.testing.assert_allclose(rec["q"].values[0, :, 1], wrist(t), atol=1e-6)


def test_a_point_in_the_image_and_the_joints_of_a_body(tmp_path, body):
    q = body.felt_robot.sample(40, seed=0).numpy() * 0.1
    with Writer(tmp_path, "ros2") as bag:
        for index, t in enumerate(START + 0.1 * np.arange(40)):
            bag.joints(t, "/js", **dict(zip(body.joints, q[index], strict=True)), jaw=0.0)
            bag.point(t, (0.01 * index, -0.02 * index, 7.0), "/hand")
    rec = bk.read_recording(bag.path, {"hand_image": "/hand"}, robot=body)
    assert rec["joint"].values.tolist() == list(body.joints)
    np.testing.assert_allclose(rec["q"].values[0], q, atol=1e-12)
    np.testing.assert_allclose(rec["hand_image"].values[0, 5], [0.05, -0.1])
    assert rec["hand_image"].attrs["units"] == "m"
    whole = bk.read_recording(bag.path, {"hand_position": "/hand"}, robot=body.robot)
    assert set(whole["joint"].values) == set(body.joints)  # the jaw is none of the robot's
    scattered = bk.read_recording(bag.path, {"hand_image": "/hand"}, robot=body, order="scattered")
    assert scattered["block"].values[0].tolist() == sorted([0, 1, 2, 3, 4] * 8)


def test_one_of_several_frames(tmp_path):
    with Writer(tmp_path, "ros1.bag") as bag:
        for t in START + 0.1 * np.arange(20):
            bag.joints(t, elbow=elbow(t - START), wrist=0.0)
            bag.transforms(t, {"marker_7": place(t - START), "/other": (9.0, 9.0, 9.0)})
    with pytest.warns(DataWarning, match="'wrist' never moves"):
        rec = bk.read_recording(bag.path, {"hand_position": "/tf[marker_7]"})
    np.testing.assert_allclose(rec["hand_position"].values[0, 3], place(0.3), atol=1e-6)
    with pytest.raises(InvalidRecording, match=r"tells of 2 things; say which: /tf\[marker_7\], /tf\[other\]"):
        bk.read_recording(bag.path)
    with pytest.raises(UnknownName, match="did you mean 'marker_7'"):
        bk.read_recording(bag.path, {"hand_position": "/tf[marker_8]"})


def test_what_no_joint_state_is_near_is_left_out_and_told(tmp_path):
    seen = START + np.r_[-0.5, 0.05 + 0.11 * np.arange(17), 2.5]
    path = plain(tmp_path, seen=seen)
    with pytest.warns(DataWarning, match=r"2 of 19 observations have no joint states within 0\.1 s on both sides"):
        rec = bk.read_recording(path, joints=JOINTS)
    assert rec.sizes["time"] == 17
    other = plain(tmp_path, "ros1.bag", seen=START + 100 + 0.1 * np.arange(20))
    with pytest.raises(InvalidRecording, match=r"no observation.*clocks are -1\d\d s apart.*join_within"):
        bk.read_recording(other, joints=JOINTS)
    gappy = tmp_path / "gap"
    with Writer(tmp_path, "gap") as bag:
        for t in START + np.r_[0.0, 0.1, 0.2, 1.2, 1.3]:
            bag.joints(t, elbow=elbow(t - START))
        for t in START + np.array([0.05, 0.15, 0.7, 1.25]):
            bag.point(t, place(t - START))
    with pytest.warns(DataWarning, match="1 of 4 observations"):
        assert bk.read_recording(gappy).sizes["time"] == 3
    assert bk.read_recording(gappy, join_within=0.6).sizes["time"] == 4


@pytest.mark.parametrize(
    ("topics", "error", "message"),
    [
        ({"q": "/joint_state"}, UnknownName, "did you mean '/joint_states'"),
        ({"q": "/marker"}, InvalidRecording, "topic '/marker' has geometry_msgs/msg/PointStamped; q needs sensor_msgs"),
        ({"hand_position": "/joint_states"}, InvalidRecording, "hand_position needs one of geometry_msgs"),
        ({"touched": "/marker"}, InvalidConfig, "of a bag 'touched' is not read"),
        ({"hand_position": "/marker", "hand_image": "/marker"}, InvalidConfig, "one of hand_position or hand_image"),
    ],
)
def test_topics_that_do_not_fit_are_named(tmp_path, topics, error, message):
    with pytest.raises(error, match=message):
        bk.read_recording(plain(tmp_path), topics)


def test_several_topics_must_be_told_apart_and_frames_must_not_mix(tmp_path):
    with Writer(tmp_path, "two") as bag:
        for t in START + 0.1 * np.arange(4):
            bag.joints(t, elbow=elbow(t - START))
            bag.point(t, place(t - START), "/left")
            bag.point(t, place(t - START), "/right")
    with pytest.raises(
        InvalidRecording, match=r"has /joint_states \(sensor.*name the topic of hand_position: columns="
    ):
        bk.read_recording(bag.path)
    mixed = plain(tmp_path, "mixed", frame=lambda t: "camera" if t < START + 1 else "world")
    with pytest.raises(InvalidRecording, match=r"several frames \(camera, world\)"):
        bk.read_recording(mixed, joints=JOINTS)
    with pytest.raises(UnknownName, match="did you mean 'elbow'"):
        bk.read_recording(plain(tmp_path, "names"), joints=["elbov"])


@pytest.mark.parametrize("name", ["damaged.bag", "damaged.mcap", "damaged.db3"])
def test_what_is_no_bag_is_one_line(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(200))
    with pytest.raises(InvalidRecording, match=rf"'{name}' is no bag that can be read: .+") as told:
        bk.read_recording(path)
    assert "\n" not in str(told.value)
    whole = plain(tmp_path, "ros1.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidRecording, match=r"'cut\.bag' is no bag that can be read"):
        bk.read_recording(tmp_path / "cut.bag")
    with pytest.raises(InvalidRecording, match="there is no recording"):
        bk.read_recording(tmp_path / "missing.bag")


PACKED = [
    ("ros1.bag", "BZ2"), ("ros1.bag", "LZ4"), ("file.mcap", "STORAGE"), ("mcap", "MESSAGE"), ("ros2", "MESSAGE"),
    ("ros2", "FILE"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "packed"), PACKED)
def test_packed_bags_say_what_they_say_unpacked_and_no_more_than_there_is_memory(tmp_path, monkeypatch, kind, packed):
    for name in ("plain", "packed"):
        (tmp_path / name).mkdir()
    path = plain(tmp_path / "packed", kind, packed=packed)
    found = bk.read_recording(path, joints=JOINTS)
    whole = bk.read_recording(plain(tmp_path / "plain", kind), joints=JOINTS)
    for name in ("q", "hand_position", "time"):
        np.testing.assert_array_equal(found[name], whole[name])
    monkeypatch.setattr(_unpacking, "MOST_UNPACKED", 20)
    monkeypatch.setattr(_unpacking, "MOST_BYTES", 20)
    with pytest.raises(InvalidRecording, match=r"unpacks to more than \d+ MiB; record it in smaller chunks") as told:
        bk.read_recording(path, joints=JOINTS)
    assert "\n" not in str(told.value)


def mcap(path, claimed, data, compression=b"zstd"):
    """One chunk alone, which claims what it likes."""
    chunk = struct.pack("<QQQLL", 0, 1, claimed, 0, len(compression)) + compression
    chunk += struct.pack("<Q", len(data)) + data
    header = struct.pack("<L", 4) + b"ros2" + struct.pack("<L", 0)
    records = [(1, header), (6, chunk), (2, bytes(20))]
    written = b"".join(bytes([kind]) + struct.pack("<Q", len(one)) + one for kind, one in records)
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + written + magic)
    return path


def bomb(size):
    """Frames without a size, as streams are packed: one honest megabyte of zeros many times over."""
    return zstd.compress(bytes(1 << 20)) * (size >> 20)


def test_what_a_chunk_claims_and_what_it_is_are_both_bounded_before_it_is_kept(tmp_path):
    too_large = r"'\w+\.mcap': a chunk unpacks to more than 256 MiB"
    with pytest.raises(InvalidRecording, match=too_large):
        bk.read_recording(mcap(tmp_path / "claims.mcap", 1 << 40, bomb(1 << 20)))
    liar = mcap(tmp_path / "liar.mcap", 100, bomb(300 << 20))
    assert liar.stat().st_size < 100_000
    tracemalloc.start()
    with pytest.raises(InvalidRecording, match=too_large):
        bk.read_recording(liar)
    assert tracemalloc.get_traced_memory()[1] < 20 << 20
    tracemalloc.stop()


def test_an_index_that_points_at_no_chunk_is_refused(tmp_path):
    path = plain(tmp_path, "file.mcap", packed="STORAGE")
    data = bytearray(path.read_bytes())
    # The record of the index: times, then the place of the chunk.
    at = data.index(b"\x08" + struct.pack("<Q", 8 * 5 + 4 + 10 * 2 + 4 + 4 + 16)) + 9 + 16
    data[at : at + 8] = struct.pack("<Q", struct.unpack("<Q", data[at : at + 8])[0] + 1)
    path.write_bytes(data)
    with pytest.raises(InvalidRecording, match="its index points at something that is no chunk"):
        bk.read_recording(path, joints=JOINTS)


def test_a_message_of_another_definition_is_refused_and_nothing_of_it_is_compiled(tmp_path):
    other = get_typestore(Stores.EMPTY)
    other.register(get_types_from_msg("float64 x\nfloat64 y", "geometry_msgs/msg/PointStamped"))
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "other", version=9) as writer:
        joints = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        points = writer.add_connection("/marker", "geometry_msgs/msg/PointStamped", typestore=other)
        for step in range(3):
            writer.write(
                points,
                step,
                other.serialize_cdr(
                    other.types["geometry_msgs/msg/PointStamped"](x=1.0, y=2.0), "geometry_msgs/msg/PointStamped"
                ),
            )
            header = store.types["std_msgs/msg/Header"](
                stamp=store.types["builtin_interfaces/msg/Time"](sec=step, nanosec=0), frame_id=""
            )
            none = np.zeros(0)
            state = store.types["sensor_msgs/msg/JointState"](
                header=header, name=["elbow"], position=np.ones(1), velocity=none, effort=none
            )
            writer.write(joints, step, store.serialize_cdr(state, "sensor_msgs/msg/JointState"))
    with pytest.raises(InvalidRecording, match="another version of geometry_msgs/msg/PointStamped"):
        bk.read_recording(tmp_path / "other")


def test_without_the_library_a_bag_says_what_to_install(tmp_path, monkeypatch):
    import sys

    path = plain(tmp_path)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(bk.errors.MissingDependency, match=r"pip install 'bodyimage-kin\[bags\]'"):
        bk.read_recording(path)
