"""One simulated arm, written as CSV, NPZ, MCAP and LeRobot: the same X, y and groups, and the friction it has."""

import numpy as np
import pytest

from sksurrogate.datasets import load_joint_log
from sksurrogate.datasets._log_rows import held, merged
from sksurrogate.datasets._log_streams import Stream
from sksurrogate.exceptions import DataError, MissingExtraError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import MuJoCoSimulator

ARM = """
<mujoco>
  <option timestep="0.005"><flag contact="disable"/></option>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" damping="0.2"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="1"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" damping="0.1" frictionloss="{friction}"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.3" mass="0.7"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor1" joint="shoulder"/>
    <motor name="motor2" joint="elbow"/>
  </actuator>
</mujoco>"""
INPUTS, OUTPUTS = ["motor1", "motor2"], ["shoulder.pos", "elbow.pos", "shoulder.vel", "elbow.vel"]
NAMES = ["shoulder", "elbow"]


def arm(friction=0.0, outputs=OUTPUTS):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra mujoco)")
    return MuJoCoSimulator(ARM.format(friction=friction), outputs=outputs, params=["elbow.damping"], dt=0.01)


@pytest.fixture(scope="module")
def runs():
    """Torques, outputs and runs of an arm with friction in its elbow."""
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1.5, 1.5, size=(6, 10, 2)), 12, axis=1)
    Y = arm(0.15).simulate_batch(U, np.tile(arm().x0, (6, 1)))
    return U.reshape(-1, 2), Y.reshape(-1, 4), np.repeat(np.arange(6), 120)


def as_csv(path, X, y, groups):
    t = 0.01 * (np.arange(len(X)) % 120)
    header = "time [s],run,motor1 [N m],motor2 [N m]," + ",".join(OUTPUTS)
    np.savetxt(path, np.column_stack([t, groups, X, y]), delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def as_mcap(mcap_log, messages, X, y, groups):
    """Joint states and torques of runs that are two seconds apart."""
    t = 0.01 * np.arange(len(X)) + 2.0 * groups
    states = [messages.joints(s, NAMES, row[:2], row[2:]) for s, row in zip(t, y)]
    return mcap_log({"/joint_states": states, "/torques": [messages.array(s, row) for s, row in zip(t, X)]})


def same(log, X, y, groups, tolerance=0.0):
    """The log holds these numbers, by these names."""
    assert log.X.columns.tolist() == INPUTS and log.y.columns.tolist() == OUTPUTS
    assert log.time is None and log.dt == 0.01
    np.testing.assert_allclose(log.X.to_numpy(), X, rtol=0, atol=tolerance)
    np.testing.assert_allclose(log.y.to_numpy(), y, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(log.groups, groups)


def test_a_csv_is_the_arm(runs, tmp_path):
    log = load_joint_log(as_csv(tmp_path / "log.csv", *runs), inputs=INPUTS)
    same(log, runs[0], runs[1], runs[2])


def test_an_npz_of_signals_is_the_arm(runs, tmp_path):
    X, y, groups = runs
    signals = {**dict(zip(INPUTS, X.T)), **dict(zip(OUTPUTS, y.T))}
    np.savez(tmp_path / "log.npz", run=groups, **signals)
    same(load_joint_log(tmp_path / "log.npz", inputs=INPUTS, dt=0.01), *runs)


def test_an_npz_of_tables_is_the_arm(runs, tmp_path):
    X, y, groups = runs
    t = 0.01 * (np.arange(len(X)) % 120)
    np.savez(tmp_path / "log.npz", q=y[:, :2], qd=y[:, 2:], tau=X, label=groups, seconds=t)
    tables = {"readings": ["q", "qd"], "commands": "tau", "run": "label", "time": "seconds"}
    same(load_joint_log(tmp_path / "log.npz", inputs=INPUTS, outputs=OUTPUTS, **tables), *runs)
    np.savez(tmp_path / "named.npz", X=X, y=y, X_names=INPUTS, y_names=OUTPUTS, run=groups, time=t)
    same(load_joint_log(tmp_path / "named.npz"), *runs)


def test_an_mcap_is_the_arm(runs, mcap_log, messages):
    log = load_joint_log(as_mcap(mcap_log, messages, *runs), inputs=INPUTS, commands="/torques", clock="header")
    same(log, *runs)
    assert log.notes == ()


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("form", [list, lambda names: {"motors": list(names)}, lambda names: [list(names)]])
def test_a_folder_of_lerobot_is_the_arm(runs, lerobot_log, version, form):
    X, y, groups = runs
    features = {"action": (X, form(INPUTS)), "observation.state": (y, form(OUTPUTS))}
    same(load_joint_log(lerobot_log(features, groups, version=version)), *runs)


def test_names_of_lerobot_need_not_be_there(runs, lerobot_log):
    X, y, groups = runs
    folder = lerobot_log({"action": (X, None), "observation.state": (y, ["state"])}, groups)
    same(load_joint_log(folder, inputs=INPUTS, outputs=OUTPUTS), *runs)
    assert load_joint_log(folder).inputs == ("action[0]", "action[1]")


def test_single_precision_is_read_as_it_is(runs, lerobot_log):
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra robots)")
    X, y, groups = runs
    kind = arrow.list_(arrow.float32(), X.shape[1])
    folder = lerobot_log({"action": (X, INPUTS), "observation.state": (y[:, :2], OUTPUTS[:2])}, groups, kind=kind)
    log = load_joint_log(folder)
    np.testing.assert_array_equal(log.y.to_numpy(), y[:, :2].astype(np.float32))


@pytest.mark.slow
def test_the_friction_of_the_arm_is_found_in_its_log(runs, mcap_log, messages):
    X, y, groups = runs
    rng = np.random.default_rng(1)
    y = y + rng.normal(scale=[1e-4, 1e-4, 1e-3, 1e-3], size=y.shape)
    simulator = arm(outputs=OUTPUTS[:2])
    path = as_mcap(mcap_log, messages, X, y, groups)
    log = load_joint_log(
        path, inputs=simulator.inputs, outputs=simulator.outputs, commands="/torques", clock="header", dt=simulator.dt
    )
    diagnoser = GapDiagnoser(
        simulator, effects=["coulomb_friction", "linear_loss", "input_gain"], time=log.time, random_state=0
    )
    report = diagnoser.fit(log.X, log.y, groups=log.groups).report_
    assert [(effect.name, effect.location) for effect in report.effects] == [("coulomb_friction", "elbow")]
    assert report.effects[0].params["level"] == pytest.approx(0.15, rel=0.05)


def test_commands_between_readings_drive_the_arm_as_their_mean(mcap_log, messages):
    """Steps of 1 ms are the arm; rows of 10 ms with the mean command follow it, with the command in force at the reading they do not."""
    fine, rng = (
        arm().set_params(model=ARM.format(friction=0).replace("0.005", "0.001"), dt=0.001),
        np.random.default_rng(0),
    )
    at = np.r_[0, np.sort(rng.choice(np.arange(1, 1190), 30, replace=False))]
    levels = rng.uniform(-1.5, 1.5, size=(31, 2))
    y = fine.simulate(levels[np.searchsorted(at, np.arange(1191), side="right") - 1])[::10]
    states = [messages.joints(0.01 * k, NAMES, row[:2], row[2:]) for k, row in enumerate(y)]
    sent = [messages.array(0.001 * k, row) for k, row in zip(at, levels)]
    coarse = fine.set_params(dt=0.01)
    path = mcap_log({"/joint_states": states, "/torques": sent})
    log = load_joint_log(path, inputs=INPUTS, outputs=OUTPUTS, commands="/torques", clock="header", dt=0.01)
    in_force = levels[np.searchsorted(at, 10 * np.arange(120), side="right") - 1]
    rmse = [np.sqrt(np.mean((coarse.simulate(U) - y) ** 2)) for U in (log.X.to_numpy(), in_force)]
    assert rmse[0] < 0.1 * rmse[1]


# ---- rows -------------------------------------------------------------------------------------------------------------
def test_held_commands_keep_their_integral():
    rng = np.random.default_rng(0)
    t, values = np.sort(rng.uniform(0, 9, 40)), rng.normal(size=40)
    t[0] = 0.0
    edges = np.linspace(0.0, 10.0, 26)
    fine = np.linspace(0.0, 10.0, 1_000_001)[:-1] + 5e-6
    acting = values[np.searchsorted(t, fine, side="right") - 1].reshape(25, -1)
    np.testing.assert_allclose(held(t, values, edges, 0.0), acting.mean(axis=1), atol=1e-3)  # of the fine grid


def test_a_command_at_a_row_is_that_of_the_row():
    t = 0.1 * np.arange(1000)
    values = np.random.default_rng(0).normal(size=1000)
    edges = np.arange(1001) / 10  # not the same numbers to the last digit
    np.testing.assert_array_equal(held(t, values, edges, 1e-7), values)


def test_streams_of_one_rate_share_rows_and_a_lone_reading_has_its_own():
    t = np.arange(5.0)
    arm_, hand = (
        Stream(name, (name,), t + late, np.arange(5.0)[:, None]) for name, late in (("arm", 0), ("hand", 0.3))
    )
    far = Stream("far", ("far",), np.array([9.0]), np.array([[7.0]]))
    rows, values, moved = merged([arm_, hand, far], ["arm", "hand", "far"])
    assert rows.tolist() == [0, 1, 2, 3, 4, 9] and moved == [("hand", pytest.approx(0.3))]
    np.testing.assert_array_equal(values[:5, 0], values[:5, 1])
    assert np.isnan(values[5, :2]).all() and values[5, 2] == 7.0


# ---- what holds for every format --------------------------------------------------------------------------------------
@pytest.fixture
def csv(tmp_path):
    def write(text):
        (tmp_path / "log.csv").write_text(text)
        return tmp_path / "log.csv"

    return write


def plain(t, column=None):
    """A table of one joint."""
    column = np.arange(len(t)) if column is None else column
    return "time,torque,elbow.pos\n" + "".join(
        f"{s!r},{k},{v}\n" for k, (s, v) in enumerate(zip(map(float, t), column))
    )


def test_uneven_rows_keep_their_times(csv):
    t = 0.01 * np.arange(50) + np.random.default_rng(0).uniform(0, 2e-3, 50)
    log = load_joint_log(csv(plain(t)), inputs=["torque"])
    assert log.time == "time" and log.X.columns.tolist() == ["torque", "time"]
    np.testing.assert_allclose(log.X["time"], t)
    np.testing.assert_array_equal(log.X["torque"], np.arange(50))
    assert "apart as a rule, with their times" in repr(log)
    bare = load_joint_log(csv(plain(t)), inputs=["torque"], as_frame=False)
    assert bare.time == 1 and isinstance(bare.X, np.ndarray)


def test_a_gap_in_a_table_is_left_to_the_diagnosis_and_a_pause_starts_a_run(csv):
    t = np.r_[np.arange(20), 23 + np.arange(20), 100 + np.arange(20)] * 0.01
    log = load_joint_log(csv(plain(t)), inputs=["torque"])
    assert log.time == "time" and log.groups.tolist() == 40 * [0] + 20 * [1]
    assert load_joint_log(csv(plain(t)), inputs=["torque"], pause=100).groups.tolist() == 60 * [0]
    labelled = csv(plain(t).replace("time,", "run,").replace("\n", ",0\n").replace("elbow.pos,0", "elbow.pos,x", 1))
    assert load_joint_log(labelled, inputs=["torque"], time="run", run="x").groups.tolist() == 60 * [0]


def test_a_coarser_dt_takes_the_nearest_readings_and_the_mean_command(csv):
    log = load_joint_log(csv(plain(0.01 * np.arange(100))), inputs=["torque"], dt=0.05)
    assert log.dt == 0.05 and log.time is None
    np.testing.assert_array_equal(log.y["elbow.pos"], np.arange(0, 100, 5))
    np.testing.assert_allclose(log.X["torque"], np.arange(0, 100, 5) + 2.0)


def test_a_finer_dt_leaves_rows_without_a_reading(csv):
    log = load_joint_log(csv(plain(0.01 * np.arange(20))), inputs=["torque"], dt=0.005)
    assert log.time is None and len(log.y) == 39
    np.testing.assert_array_equal(log.y["elbow.pos"][::2], np.arange(20))
    assert log.y["elbow.pos"][1::2].isna().all()
    np.testing.assert_array_equal(log.X["torque"], np.repeat(np.arange(20), 2)[:39])


def test_degrees_become_radians_where_asked(csv):
    text = plain(0.01 * np.arange(20)).replace("torque", "elbow.target")
    log = load_joint_log(csv(text), inputs=["elbow.target"], degrees=["*.pos", "elbow*"])
    np.testing.assert_allclose(log.y["elbow.pos"], np.deg2rad(np.arange(20)))
    np.testing.assert_allclose(log.X["elbow.target"], np.deg2rad(np.arange(20)))
    assert load_joint_log(csv(text), inputs=["elbow.target"]).y["elbow.pos"][19] == 19


def test_names_of_the_simulator_stand_for_those_of_the_log(csv):
    path = csv(plain(0.01 * np.arange(20)))
    log = load_joint_log(path, inputs={"motor": "torque"}, outputs={"joint2.pos": "elbow.pos"})
    assert log.inputs == ("motor",) and log.outputs == ("joint2.pos",)
    assert load_joint_log(path, inputs=[], outputs=["elbow.pos"]).X.shape == (20, 0)


EVEN = plain(0.01 * np.arange(20))


@pytest.mark.parametrize(
    "text, options, match",
    [
        (EVEN, {}, r"inputs=None: the file does not say .* out of \['torque', 'elbow.pos'\]"),
        (EVEN, {"inputs": ["torqe"]}, r"inputs: the log has no signal 'torqe'; did you mean 'torque'\? .* A dict renames"),
        (EVEN, {"inputs": ["torque", "torque"]}, "inputs: 'torque' is listed twice"),
        (EVEN, {"inputs": ["torque"], "outputs": ["wrist.pos"]}, "outputs: the log has no signal 'wrist.pos'"),
        (EVEN, {"inputs": ["torque"], "outputs": []}, "name at least one"),
        (EVEN.replace("elbow.pos", "q"), {"inputs": ["torque"]}, "no signal of the file is called <joint>.pos"),
        (EVEN, {"inputs": ["torque"], "time": "clock"}, "time='clock' is not in the log"),
        (EVEN, {"inputs": ["torque"], "run": "trial"}, "run='trial' is not in the log"),
        (EVEN, {"inputs": ["torque"], "readings": "q"}, "is a CSV, which has columns alone"),
        (EVEN, {"inputs": ["torque"], "clock": "log"}, "clock='log': the log is a file without messages"),
        (EVEN, {"inputs": ["torque"], "clock": "sun"}, "expected 'auto', 'header' or 'log'"),
        (EVEN, {"inputs": ["torque"], "dt": 0.0}, "dt=0.0: expected a number above 0"),
        (EVEN, {"inputs": ["torque"], "pause": "1"}, "pause='1': expected a number above 0"),
        (EVEN, {"inputs": ["torque"], "dt": 0.003}, "dt=0.003: the readings come every 0.01 s, not at multiples of dt"),
        (EVEN, {"inputs": ["torque"], "degrees": "wrist*"}, r"degrees: no signal is called 'wrist\*'"),
        (EVEN.replace("time", "elapsed"), {"inputs": ["torque"]}, "has no time: give dt="),
        (EVEN.replace("0.05,5,", "0.03,5,"), {"inputs": ["torque"]}, "time does not increase after row 4"),
        (EVEN.replace("0.05,5,", "0.05,,"), {"inputs": ["torque"]}, "line 7, column 'torque': the cell is empty"),
        (plain([0.0]), {"inputs": ["torque"]}, "at least two in a row are needed"),
        (
            plain(np.r_[0.0, 0.01, 0.02, 9.0]),
            {"inputs": ["torque"], "pause": 1e6, "dt": 0.001},
            "dt=0.001: what entered in the gap from 0.02 to 9 s is not known",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(csv, text, options, match):
    with pytest.raises(DataError, match=match):
        load_joint_log(csv(text), **options)


@pytest.mark.parametrize(
    "name, match",
    [
        ("none.csv", "there is no such file or folder in"),
        ("log.db3", "ros2 bag convert"),
        ("log.bag", "mcap convert"),
        ("log.parquet", "give the folder that holds meta/ and data/"),
        ("log.xyz", r"no format that is read: .csv, .npz, .mcap"),
        ("folder", "is a folder without meta/info.json"),
    ],
)
def test_another_format_is_said(tmp_path, name, match):
    for file in ("log.db3", "log.bag", "log.parquet", "log.xyz"):
        (tmp_path / file).touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(DataError, match=match):
        load_joint_log(tmp_path / name, inputs=["torque"])


def test_an_extra_that_lacks_is_named(csv, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(MissingExtraError, match=r"sksurrogate\[frames\]', or give as_frame=False"):
        load_joint_log(csv(EVEN), inputs=["torque"])
    assert len(load_joint_log(csv(EVEN), inputs=["torque"], as_frame=False).X) == 20


def test_arrays_of_an_npz_are_checked(tmp_path):
    path, t = tmp_path / "log.npz", 0.01 * np.arange(20)

    def refused(match, options=None, **arrays):
        np.savez(path, **arrays)
        with pytest.raises(DataError, match=match):
            load_joint_log(path, **({"inputs": ["u"]} if options is None else options))

    q, u = np.zeros(20), np.ones(20)
    refused("'time' has 20 rows and 'u' has 19|'u' has 19 rows and 'time' has 20|'u' has 19 rows and 'elbow.pos' has 20",
            time=t, u=u[:19], **{"elbow.pos": q})  # fmt: skip
    refused(
        r"inputs: 'u' of log.npz has shape \(20, 2\).* give commands='u'",
        time=t,
        u=np.ones((20, 2)),
        **{"elbow.pos": q},
    )
    refused(
        "input 'u' is nan in row 3; 1 values in all",
        time=t,
        u=np.where(np.arange(20) == 3, np.nan, u),
        **{"elbow.pos": q},
    )
    refused("'u' holds <U1, expected real numbers", time=t, u=np.full(20, "a"), **{"elbow.pos": q})
    refused("the array 'u' cannot be read .*Object arrays", time=t, u=np.array(20 * [None]), **{"elbow.pos": q})
    refused("outputs: 'elbow.pos' has no number|y holds no measured value", time=t, u=u, **{"elbow.pos": np.nan * q})
    tables = {"commands": "tau", "readings": "q"}
    refused(r"commands='tau' is not in log.npz; .*its arrays are \['time', 'q'\]", tables, time=t, q=np.zeros((20, 2)))
    refused(r"has shape \(4, 5, 2\), expected \(n_samples, n_signals\)", tables, time=t, q=q, tau=np.zeros((4, 5, 2)))
    named = {**tables, "inputs": ["a", "b", "c"]}
    refused(r"3 names for the 2 signals \['tau\[0\]', 'tau\[1\]'\]", named, time=t, q=q, tau=np.zeros((20, 2)))
    refused(
        "tau_names holds .* expected 2 different names", tables, time=t, q=q, tau=np.zeros((20, 2)), tau_names=["a"]
    )
    path.write_bytes(b"PK no zip")
    with pytest.raises(DataError, match=r"log\.npz is no NPZ that can be read"):
        load_joint_log(path, inputs=["u"])
