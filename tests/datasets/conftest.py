"""Joint logs written as their own libraries write them."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

HEADER = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINTS = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + HEADER
ARRAY = """MultiArrayLayout layout
float64[] data
================================================================================
MSG: std_msgs/MultiArrayLayout
MultiArrayDimension[] dim
uint32 data_offset
================================================================================
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""
KINDS = {
    "joints": ("sensor_msgs/msg/JointState", JOINTS),
    "array": ("std_msgs/msg/Float64MultiArray", ARRAY),
    "number": ("std_msgs/msg/Float64", "float64 data\n"),
    "text": ("std_msgs/msg/String", "string data\n"),
}
START = 1_700_000_000 * 10**9


def joints(t, name, position=(), velocity=(), effort=(), stamp=True):
    """(time, kind, message) of a joint state."""
    ns = START + round(t * 1e9) if stamp else 0
    header = {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": ""}
    fields = {"position": position, "velocity": velocity, "effort": effort}
    message = {"header": header, "name": list(name), **{key: list(map(float, part)) for key, part in fields.items()}}
    return t, "joints", message


def array(t, data):
    """(time, kind, message) of an array."""
    layout = {"dim": [], "data_offset": 0}
    return t, "array", {"layout": layout, "data": list(map(float, data))}


@pytest.fixture
def mcap_log(tmp_path):
    """Writes messages {topic: [(time, kind, message)]} in the order given, or in that of time."""
    pytest.importorskip("mcap", reason="mcap is not installed (extra robots)")
    writer = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed (extra robots)")

    def write(topics, name="log.mcap", delay=0.0, **options):
        path = tmp_path / name
        with path.open("wb") as stream:
            out = writer.Writer(stream, **options)
            schemas = {kind: out.register_msgdef(*definition) for kind, definition in KINDS.items()}
            for topic, messages in topics.items():
                for t, kind, message in messages:
                    ns = START + round((t + delay) * 1e9)
                    out.write_message(topic, schemas[kind], message, log_time=ns, publish_time=ns)
            out.finish()
        return path

    return write


@pytest.fixture
def lerobot_log(tmp_path):
    """Writes a folder of LeRobot from features {name: (values, names)} and episodes; version 2 or 3."""
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra robots)")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra robots)")

    def write(features, episodes, fps=100, version=3, name="robot", kind=None, **info):
        folder = tmp_path / name
        frame = np.concatenate([np.arange(np.sum(episodes == one)) for one in dict.fromkeys(episodes.tolist())])
        kind = arrow.list_(arrow.float64()) if kind is None else kind
        table = {
            **{key: arrow.array(list(values), kind) for key, (values, _) in features.items()},
            "timestamp": arrow.array((frame / fps).astype(np.float32)),
            "frame_index": arrow.array(frame),
            "episode_index": arrow.array(episodes),
            "index": arrow.array(np.arange(len(frame))),
        }
        table = arrow.table(table)
        if version == 3:
            files = {"data/chunk-000/file-000.parquet": episodes < 1, "data/chunk-000/file-001.parquet": episodes >= 1}
        else:
            files = {f"data/chunk-000/episode_{k:06d}.parquet": episodes == k for k in np.unique(episodes)}
        for file, rows in files.items():
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            parquet.write_table(table.filter(arrow.array(rows)), folder / file)
        told = {
            key: {"dtype": "float32", "shape": [np.shape(values)[1]], "names": names}
            for key, (values, names) in features.items()
        }
        told["observation.images.top"] = {
            "dtype": "video",
            "shape": [480, 640, 3],
            "names": ["height", "width", "channels"],
        }
        told["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
        (folder / "meta").mkdir(exist_ok=True)
        told = {"codebase_version": f"v{version}.0", "fps": fps, "total_frames": len(frame), "features": told, **info}
        (folder / "meta" / "info.json").write_text(json.dumps(told))
        return folder

    return write


@pytest.fixture
def messages():
    """Makers of messages."""
    return SimpleNamespace(joints=joints, array=array, start=START)
