"""Folders of LeRobot: features, frames that lack, folders that are not whole."""

import json

import numpy as np
import pytest

from sksurrogate.datasets import load_joint_log
from sksurrogate.exceptions import DataError, MissingExtraError

EPISODES = np.repeat([0, 1], 50)
VALUES = np.arange(200.0).reshape(100, 2)


@pytest.fixture
def folder(lerobot_log):
    """Commands and positions of two joints, and their velocities under the same names."""
    names = ["elbow", "wrist"]
    features = {"action": VALUES, "observation.state": -VALUES, "observation.velocity": 2 * VALUES}
    return lerobot_log({key: (values, names) for key, values in features.items()}, EPISODES, fps=30)


def test_frames_are_a_frame_time_apart(folder):
    log = load_joint_log(folder, outputs=["elbow.pos", "wrist.pos"])
    assert log.time is None and log.dt == pytest.approx(1 / 30) and log.outputs == ("elbow.pos", "wrist.pos")
    np.testing.assert_array_equal(log.y, -VALUES)
    np.testing.assert_array_equal(log.groups, EPISODES)
    assert log.groups.dtype.kind == "i"


def test_features_with_the_same_names_are_told_apart(folder):
    readings = ["observation.state", "observation.velocity"]
    outputs = {"elbow.pos": "observation.state:elbow", "elbow.vel": "observation.velocity:elbow"}
    log = load_joint_log(folder, readings=readings, outputs=outputs)
    np.testing.assert_array_equal(log.y, np.column_stack([-VALUES[:, 0], 2 * VALUES[:, 0]]))
    assert load_joint_log(folder, inputs=[]).X.shape == (100, 0)


def edited(folder, change):
    """The folder with another table of frames, or another meta/info.json."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed (extra robots)")
    file = folder / "data/chunk-000/file-000.parquet"
    parquet.write_table(change(parquet.read_table(file)), file)


def test_frames_that_lack_leave_a_gap_and_a_note(folder):
    edited(folder, lambda table: table.filter(np.arange(50) != 20))
    log = load_joint_log(folder)
    assert log.time == "time" and len(log.X) == 99
    assert np.diff(log.X["time"])[19] == pytest.approx(2 / 30)
    assert log.notes == ("meta/info.json tells of 100 frames, the files hold 99: the folder is not whole.",)


def test_stamps_that_are_not_those_of_the_frames_count(folder):
    t = np.cumsum(np.random.default_rng(0).uniform(0.03, 0.036, 50))
    edited(folder, lambda table: table.set_column(table.column_names.index("timestamp"), "timestamp", [t]))
    log = load_joint_log(folder)
    assert log.time == "time"
    np.testing.assert_allclose(log.X["time"][:50], t)


@pytest.mark.parametrize(
    "options, match",
    [
        ({"commands": "actions"}, r"commands='actions' is no feature of the log; did you mean 'action' or .*\? .*'observation.velocity'\]"),
        ({"readings": "observation.images.top"}, r"holds video of shape \[480, 640, 3\], expected a vector of numbers"),
        ({"inputs": ["shoulder"]}, r"inputs: the log has no signal 'shoulder'; .*\['elbow', 'wrist'\]"),
        ({"run": "episode_index"}, "run='episode_index': the log is a folder of LeRobot"),
    ],
)  # fmt: skip
def test_what_is_asked_wrongly_is_said(folder, options, match):
    with pytest.raises(DataError, match=match):
        load_joint_log(folder, **options)


def test_a_folder_that_is_not_whole_is_said(folder):
    file, info = folder / "data/chunk-000/file-001.parquet", folder / "meta/info.json"

    def refused(match):
        with pytest.raises(DataError, match=match):
            load_joint_log(folder)

    whole = file.read_bytes()
    file.write_bytes(whole[:300])
    refused(r"robot/data/chunk-000/file-001.parquet cannot be read as Parquet .*copy or download it again")
    file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
    refused("is a pointer of Git LFS: type  git lfs pull")
    file.write_bytes(whole)
    edited(folder, lambda table: table.drop_columns(["action"]))
    refused(r"file-000.parquet has no column 'action'; its columns are")
    for lost in folder.rglob("*.parquet"):
        lost.unlink()
    refused("robot/data holds no Parquet file")
    told = json.loads(info.read_text())
    info.write_text(json.dumps({**told, "fps": None}))
    refused(r"robot/meta/info.json does not say what the data are \(TypeError.*'fps' and 'features'")
    info.write_text("{")
    refused("does not say what the data are")


def test_rows_of_different_lengths_are_said(folder):
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra robots)")
    ragged = arrow.array([[1.0]] + [[1.0, 2.0]] * 48 + [[1.0, 2.0, 3.0]])
    edited(folder, lambda table: table.set_column(0, "action", ragged))
    with pytest.raises(DataError, match=r"column 'action': rows hold lists of \[1, 2, 3\] numbers"):
        load_joint_log(folder)


def test_the_extra_is_named(folder, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtraError, match=r"pyarrow.parquet is needed here .*sksurrogate\[robots\]"):
        load_joint_log(folder)
