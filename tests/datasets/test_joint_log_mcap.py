"""Messages of MCAP as robots send them: late, twice, without stamps, without some joints, on several topics."""

import json

import numpy as np
import pytest

from sksurrogate.datasets import load_joint_log
from sksurrogate.exceptions import DataError, MissingExtraError

T = 0.01 * np.arange(100)
TOPIC = "/joint_states"


@pytest.fixture
def states(messages):
    """Joint states of an elbow whose position is the time, with effort."""

    def make(t=T, names=("elbow",), **options):
        fields = {"position": 1, "velocity": 2, "effort": 3} | options.pop("fields", {})
        return [
            messages.joints(s, names, **{key: len(names) * [factor * s] for key, factor in fields.items() if factor}, **options)
            for s in t
        ]  # fmt: skip

    return make


def test_the_effort_of_the_readings_is_the_input_where_no_commands_are_named(mcap_log, states):
    log = load_joint_log(mcap_log({TOPIC: states()}))
    assert log.inputs == ("elbow.effort",) and log.outputs == ("elbow.pos", "elbow.vel")
    assert log.time is None and log.dt == 0.01
    np.testing.assert_allclose(log.y, np.column_stack([T, 2 * T]))
    np.testing.assert_allclose(log.X["elbow.effort"], 3 * T)
    np.testing.assert_array_equal(log.stamps, T)
    assert load_joint_log(mcap_log({TOPIC: states()}), inputs=["elbow"]).inputs == ("elbow",)
    assert load_joint_log(mcap_log({TOPIC: states()}), outputs=["elbow.effort"]).y.columns.tolist() == ["elbow.effort"]


def test_commands_at_other_times_act_as_their_mean_over_a_row(mcap_log, states, messages):
    sent = [messages.array(s, [k]) for k, s in enumerate(T - 0.003)]
    log = load_joint_log(
        mcap_log({TOPIC: states(), "/torque": sent}), inputs=["motor"], commands="/torque", clock="header"
    )
    expected = np.r_[0.7 * np.arange(99) + 0.3 * np.arange(1, 100), 99]
    np.testing.assert_allclose(log.X["motor"], expected)
    np.testing.assert_array_equal(log.X.index, range(100))


def test_readings_before_the_first_command_are_left_out(mcap_log, states, messages):
    path = mcap_log({TOPIC: states(), "/torque": [messages.array(0.305, [2.0])]})
    log = load_joint_log(path, inputs=["motor"], commands="/torque", clock="header")
    assert len(log.X) == 69 and log.stamps[0] == pytest.approx(0.31) and (log.X["motor"] == 2.0).all()
    assert log.notes == ("Left out, readings before the first command: 31. What acted then is not known.",)
    late = mcap_log({TOPIC: states(), "/torque": [messages.array(5.0, [2.0])]})
    with pytest.raises(
        DataError, match=r"no two readings follow the first command: this comes at 5 s, the last reading at 0.99 s"
    ):
        load_joint_log(late, inputs=["motor"], commands="/torque", clock="header")


def test_messages_out_of_order_are_sorted_and_those_sent_twice_count_once(mcap_log, states):
    sent = states()
    sent[10], sent[11] = sent[11], sent[10]
    sent.insert(50, sent[49])
    log = load_joint_log(mcap_log({TOPIC: sent}))
    np.testing.assert_array_equal(log.y["elbow.pos"], T)
    assert log.notes == (f"Sorted, messages of {TOPIC} that came out of order: 1.",)


def test_two_readings_at_one_time_that_differ_are_refused(mcap_log, states, messages):
    sent = states()
    sent.insert(50, messages.joints(T[49], ["elbow"], [7.0], [0.0], [0.0]))
    with pytest.raises(DataError, match=r"two readings of 'elbow.pos' at the same time, 0.49 s .*clock='log'"):
        load_joint_log(mcap_log({TOPIC: sent}))


def test_one_clock_counts_for_all_topics(mcap_log, states, messages):
    path = mcap_log({TOPIC: states(), "/torque": [messages.array(s, [1.0]) for s in T]}, delay=0.5)
    log = load_joint_log(path, inputs=["motor"], commands="/torque")
    assert len(log.X) == 100 and log.notes == (
        "Messages of ['/torque'] have no stamp in a header: the times of recording count for all topics.",
    )
    assert len(load_joint_log(path, inputs=["motor"], commands="/torque", clock="log").X) == 100
    header = load_joint_log(path, inputs=["motor"], commands="/torque", clock="header")
    assert len(header.X) == 50 and header.notes[0].startswith("Left out, readings before the first command: 50")
    bare = load_joint_log(mcap_log({TOPIC: states(stamp=False)}))
    np.testing.assert_allclose(bare.y["elbow.pos"], T)
    assert bare.notes == ()


def test_a_simulated_clock_begins_at_zero(mcap_log, states, messages):
    slow = [(4.0 * s, kind, message) for s, kind, message in states()]  # recorded at a quarter of the speed
    for s, _, message in slow:
        ns = round(s / 4.0 * 1e9)
        message["header"]["stamp"] = {"sec": ns // 10**9, "nanosec": ns % 10**9}
    log = load_joint_log(mcap_log({TOPIC: slow}))
    assert log.dt == 0.01 and log.notes == ()
    np.testing.assert_array_equal(log.y["elbow.pos"], T)


def test_jitter_keeps_the_stamps(mcap_log, states):
    t = T + np.random.default_rng(0).uniform(-1e-3, 1e-3, 100)
    log = load_joint_log(mcap_log({TOPIC: states(t)}))
    assert log.time == "time" and log.dt == pytest.approx(0.01, rel=1e-2)
    np.testing.assert_allclose(log.X["time"], t - t[0], atol=1e-8)
    np.testing.assert_allclose(log.X["time"] + t[0], log.y["elbow.pos"], atol=1e-8)


def test_a_pause_starts_a_run_and_lost_readings_are_nan_where_commands_go_on(mcap_log, states, messages):
    read = np.r_[T[:40], T[45:80], 3.0 + T[:20], 9.0]
    sent = [messages.array(s, [k]) for k, s in enumerate(np.r_[T, 3.0 + T])]
    path = mcap_log({TOPIC: states(read), "/torque": sent})
    log = load_joint_log(path, inputs=["motor"], commands="/torque", clock="header")
    assert log.time is None and log.groups.tolist() == 80 * [0] + 20 * [1]
    assert log.y["elbow.pos"][40:45].isna().all() and log.y["elbow.pos"].notna().sum() == 95
    np.testing.assert_array_equal(log.X["motor"], np.r_[np.arange(80), 100 + np.arange(20)])
    assert log.notes == ("Left out, readings alone between two pauses: 1.",)
    with pytest.raises(DataError, match=r"are spread over 901 rows of dt=0\.01: give a smaller pause="):
        few = mcap_log({TOPIC: states(np.r_[T[:10], 9.0]), "/torque": sent})
        load_joint_log(few, inputs=["motor"], commands="/torque", clock="header", pause=1e6)


def test_a_message_may_lack_joints(mcap_log, states, messages):
    both = states(names=("elbow", "wrist"))
    both[30] = messages.joints(T[30], ["elbow"], [T[30]], [0.0], [9.0])
    log = load_joint_log(mcap_log({TOPIC: both}), outputs=["wrist.pos", "elbow.pos"])
    assert np.isnan(log.y["wrist.pos"][30]) and log.y["elbow.pos"][30] == T[30]
    assert log.y.isna().sum().tolist() == [1, 0]
    assert log.X["elbow.effort"][30] == 9.0 and log.X["wrist.effort"][30] == pytest.approx(3 * T[29])


def test_two_publishers_on_one_topic_share_rows(mcap_log, states):
    hand = states(T[:-1] + 0.002, names=("grip",))
    log = load_joint_log(mcap_log({TOPIC: sorted(states() + hand, key=lambda sent: sent[0])}), inputs=["elbow.effort"])
    assert log.time is None and len(log.y) == 100
    np.testing.assert_allclose(log.y["grip.pos"][:-1], T[:-1] + 0.002)
    assert log.notes == (f"Readings of {TOPIC} were moved by up to 0.002 s to the rows of the others.",)


def test_two_topics_with_the_same_names_are_told_apart(mcap_log, states):
    path = mcap_log({"/left": states(), "/right": states(fields={"position": 5})})
    log = load_joint_log(path, readings=["/left", "/right"], inputs=[], outputs=["/left:elbow.pos", "/right:elbow.pos"])
    np.testing.assert_allclose(log.y, np.column_stack([T, 5 * T]))
    with pytest.raises(DataError, match=r"several topics of joint states, \['/left', '/right'\]"):
        load_joint_log(path)
    log = load_joint_log(path, commands="/left", inputs={"target": "elbow.pos"})
    assert log.inputs == ("target",) and log.outputs == ("elbow.pos", "elbow.vel")
    with pytest.raises(DataError, match=r"inputs: 'elbow' may be any of \['elbow.pos', 'elbow.vel', 'elbow.effort'\]"):
        load_joint_log(path, commands="/left", inputs=["elbow"])


def test_numbers_of_their_own_topics_are_inputs(mcap_log, states):
    numbers = {
        f"/{name}/command": [(s, "number", {"data": factor * s}) for s in T]
        for name, factor in (("a", 2.0), ("b", 3.0))
    }
    log = load_joint_log(
        mcap_log({TOPIC: states(), **numbers}), inputs=["a", "b"], commands=list(numbers), clock="header"
    )
    np.testing.assert_allclose(log.X, np.column_stack([2 * T, 3 * T]))


def test_nan_in_a_joint_state_is_not_measured(mcap_log, states):
    log = load_joint_log(mcap_log({TOPIC: states(fields={"velocity": np.nan})}))
    assert log.outputs == ("elbow.pos",)


def test_files_of_one_recording_are_joined(mcap_log, states, tmp_path):
    for k, rows in enumerate((slice(60, 100), slice(0, 60))):
        mcap_log({TOPIC: states(T[rows])}, name=f"bag_{k}.mcap")
    log = load_joint_log(tmp_path)
    np.testing.assert_array_equal(log.y["elbow.pos"], T)


def test_a_file_without_an_index_is_read(states, tmp_path, messages):
    pytest.importorskip("mcap", reason="mcap is not installed (extra robots)")
    from mcap.writer import CompressionType, IndexType, Writer

    with (tmp_path / "log.mcap").open("wb") as stream:
        out = Writer(
            stream, index_types=IndexType.NONE, use_chunking=False, use_summary_offsets=False, repeat_channels=False,
            repeat_schemas=False, use_statistics=False, compression=CompressionType.NONE,
        )  # fmt: skip
        out.start()
        schema = out.register_schema("JointState", "jsonschema", b"{}")
        channel = out.register_channel(TOPIC, "json", schema)
        for t, _, message in states():
            ns = messages.start + round(t * 1e9)
            out.add_message(channel, ns, json.dumps(message).encode(), ns)
        out.finish()
    log = load_joint_log(tmp_path / "log.mcap")
    np.testing.assert_array_equal(log.y["elbow.pos"], T)


def test_messages_of_ros_1_are_read(tmp_path, states, messages):
    pytest.importorskip("mcap", reason="mcap is not installed (extra robots)")
    decoder = pytest.importorskip("mcap_ros1.decoder", reason="mcap-ros1-support is not installed (extra robots)")
    from mcap_ros1.writer import Writer

    definition = (
        "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + 80 * "=" +
        "\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    )  # fmt: skip
    kind = decoder.dynamic.generate_dynamic("sensor_msgs/JointState", definition)["sensor_msgs/JointState"]
    with (tmp_path / "log.mcap").open("wb") as stream, Writer(stream) as out:
        for t, _, message in states():
            sent = kind(**{key: message[key] for key in ("name", "position", "velocity", "effort")})
            sent.header.stamp.secs, sent.header.stamp.nsecs = message["header"]["stamp"].values()
            out.write_message(TOPIC, sent, messages.start, messages.start)  # all logged at one time: stamps tell
    log = load_joint_log(tmp_path / "log.mcap")
    np.testing.assert_array_equal(log.y["elbow.pos"], T)
    np.testing.assert_array_equal(log.stamps, T)


@pytest.mark.parametrize(
    "options, match",
    [
        ({"readings": "/joints"}, r"readings='/joints' is no topic of the log; .*'/joint_states' \(sensor_msgs/msg/JointState, 100 messages\)"),
        ({"commands": "/text"}, "topic '/text' holds std_msgs/msg/String, expected joint states"),
        ({"commands": "/ragged"}, "topic '/ragged': arrays of 1 and of 2 numbers"),
        ({"commands": "/torque", "inputs": ["a", "b", "c"]}, r"inputs: 3 names for the 2 signals \['/torque\[0\]'"),
        ({"outputs": ["wrist.pos"]}, r"outputs: the log has no signal 'wrist.pos'; .*\['elbow.pos', 'elbow.vel'\]"),
        ({}, r"inputs=None: \['/joint_states'\] has no effort; give commands="),
        ({"time": "t"}, "time='t': the log is an MCAP file, which does not take it"),
        ({"readings": "/twice"}, r"lists a joint twice, \['elbow', 'elbow'\]"),
        ({"readings": "/short"}, r"2 names, \['elbow', 'wrist'\], and 1 values of position"),
        ({"readings": "/empty", "inputs": [], "outputs": ["elbow.pos"]}, "have no number in any message"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(mcap_log, states, messages, options, match):
    topics = {
        TOPIC: states(fields={"effort": 0}),
        "/text": [(0.0, "text", {"data": "go"})],
        "/ragged": [messages.array(0.0, [1.0]), messages.array(0.1, [1.0, 2.0])],
        "/torque": [messages.array(0.0, [1.0, 2.0])],
        "/twice": [messages.joints(0.0, ["elbow", "elbow"], [1.0, 2.0])],
        "/short": [messages.joints(0.0, ["elbow", "wrist"], [1.0])],
        "/empty": [messages.joints(s, ["elbow"], [np.nan]) for s in T],
    }
    if not {"readings"} & set(options):
        options = {"readings": TOPIC, **options}
    with pytest.raises(DataError, match=match):
        load_joint_log(mcap_log(topics), **options)


def test_a_recording_without_joint_states_lists_its_topics(mcap_log, messages):
    path = mcap_log({"/torque": [messages.array(0.0, [1.0])]})
    with pytest.raises(
        DataError,
        match=r"no topic of sensor_msgs/JointState: .*'/torque' \(std_msgs/msg/Float64MultiArray, 1 messages\)",
    ):
        load_joint_log(path)


def test_a_damaged_file_is_said(mcap_log, states):
    path = mcap_log({TOPIC: states()})
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"log.mcap is cut off or damaged \(.*mcap recover log.mcap -o whole.mcap"):
        load_joint_log(path)
    path.write_bytes(whole[:1500] + bytes(100) + whole[1600:])
    with pytest.raises(DataError, match="is cut off or damaged"):
        load_joint_log(path)
    path.write_bytes(b"time,q\n" * 50)
    with pytest.raises(DataError, match=r"log\.mcap is no MCAP file"):
        load_joint_log(path)


def test_another_encoding_is_said(tmp_path):
    writer = pytest.importorskip("mcap.writer", reason="mcap is not installed (extra robots)")
    with (tmp_path / "log.mcap").open("wb") as stream:
        out = writer.Writer(stream)
        out.start()
        channel = out.register_channel(TOPIC, "protobuf", out.register_schema("JointState", "protobuf", b""))
        out.add_message(channel, 0, b"", 0)
        out.finish()
    with pytest.raises(DataError, match="is encoded as 'protobuf' with definitions in 'protobuf'; read are ROS 2"):
        load_joint_log(tmp_path / "log.mcap")


@pytest.mark.parametrize("module", ["mcap", "mcap_ros2.decoder"])
def test_an_extra_that_lacks_is_named(mcap_log, states, monkeypatch, module):
    path = mcap_log({TOPIC: states()})
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{module} is needed here .*sksurrogate\[robots\]"):
        load_joint_log(path)
