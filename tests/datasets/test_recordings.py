"""Recordings: known files are used, damaged ones refused, archives converted; the network is the loopback."""

import http.server
import io
import os
import threading
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from sksurrogate.datasets import (
    _recordings,
    fetch_ball_drops,
    fetch_cascaded_tanks,
    fetch_heat_exchanger,
    fetch_silverbox,
)
from sksurrogate.datasets._ball_drops import _BALLS_COLUMNS, _drops
from sksurrogate.exceptions import DataError

SHARED = Path(os.environ.get("SKSURROGATE_DATA") or Path(__file__).parents[2].parent / "shared" / "data")


@pytest.mark.skipif(not SHARED.exists(), reason="the real recordings are not on this machine")
def test_known_files_are_used():
    tanks, box = fetch_cascaded_tanks(SHARED), fetch_silverbox(SHARED)
    assert tanks.uEst.shape == tanks.yVal.shape == (1024,) and tanks.Ts == 4.0
    assert box.V1.shape == (131072,) and box.fs == pytest.approx(610.3516, abs=1e-3)
    # the arrow, which grows, then the multisine; three quarters of this are for training
    multisine = slice(box.train.start, box.test_multisine.stop)
    assert box.train.stop == box.test_multisine.start and box.test_arrow.stop <= multisine.start
    assert box.train.stop - multisine.start == pytest.approx(0.75 * (multisine.stop - multisine.start), abs=1)
    arrow, steady = np.abs(box.V1[box.test_arrow]), np.abs(box.V1[multisine])
    assert arrow[-2000:].max() > 4 * arrow[:2000].max() and steady[-2000:].max() < 2 * steady[:2000].max()


@pytest.mark.skipif(not SHARED.exists(), reason="the real recordings are not on this machine")
def test_balls_fall_and_water_is_warm():
    balls, water = fetch_ball_drops(SHARED), fetch_heat_exchanger(SHARED)
    assert len(balls.names) == 11 and set(balls.drop) == {1, 2} and len(balls.height) == len(balls.ball) == 1064
    golf = (balls.ball == "Golf Ball") & (balls.drop == 1)
    t, h = balls.time[golf], balls.height[golf]
    assert -2 * np.polyfit(t, h, 2)[0] == pytest.approx(9.81, rel=0.05)  # free fall
    assert water.q.shape == water.th.shape == (4000,) and water.th.min() > 92 and water.th.max() < 102
    assert np.corrcoef(water.q, water.th)[0, 1] < 0  # more flow, less warm


def known(monkeypatch, name, arrays):
    """These numbers are the known ones of a recording."""
    source = getattr(_recordings, name)
    numbers = _recordings._numbers(arrays, source.signals)
    monkeypatch.setattr(_recordings, name, replace(source, numbers=numbers))


@pytest.mark.parametrize("delimiter", [" ", ";", ","])
def test_balls_and_exchanger_from_elsewhere(delimiter, server, tmp_path, monkeypatch):
    pytest.importorskip("pooch")
    folder, address = server
    table = np.column_stack([np.arange(4000), np.linspace(0.1, 0.7, 4000), np.linspace(93, 101, 4000)])
    np.savetxt(folder / "exchanger.dat", table, delimiter=delimiter)
    known(monkeypatch, "_EXCHANGER", {"q": table[:, 1], "th": table[:, 2]})
    (folder / "balls.csv").write_text(
        "ball,drop,time_s,height_m,velocity_m_s\nTin,1,0.0,40.0,0.1\nTin,2,0.1,39.0,-0.1\n"
    )
    for _ in range(2):  # the second time from the disk
        water = fetch_heat_exchanger(tmp_path, url=f"{address}/exchanger.dat")
        np.testing.assert_allclose(water.th, table[:, 2])
        balls = fetch_ball_drops(tmp_path, url=f"{address}/balls.csv")
        assert balls.names == ["Tin"] and balls.height.tolist() == [40.0, 39.0]
    (folder / "other.dat").write_text("no numbers")
    with pytest.raises(DataError, match="not a table of numbers"):
        fetch_heat_exchanger(tmp_path / "other", url=f"{address}/other.dat")
    with pytest.raises(DataError, match="save the authors' spreadsheet there as CSV"):
        fetch_ball_drops(tmp_path / "other")
    (folder / "wrong.csv").write_text("a,b\n")
    with pytest.raises(DataError, match="has not the columns"):
        fetch_ball_drops(tmp_path / "other", url=f"{address}/wrong.csv")
    with (tmp_path / "ball_drops" / "ball_drops.csv").open("a") as file:
        file.write("Tin,2,0.2,38.0,-0.2\n")
    with pytest.raises(DataError, match="is damaged"):
        fetch_ball_drops(tmp_path)


def test_a_damaged_file_is_refused(tmp_path):
    (tmp_path / "cascaded_tanks").mkdir()
    (tmp_path / "cascaded_tanks" / "cascaded_tanks.npz").write_bytes(b"not a zip")
    with pytest.raises(DataError, match="is damaged"):
        fetch_cascaded_tanks(tmp_path)


def test_a_missing_file_without_download_says_where_it_belongs(tmp_path):
    with pytest.raises(DataError, match=r"silverbox_SNLS80mV\.npz is not there"):
        fetch_silverbox(tmp_path, download_if_missing=False)


@pytest.fixture
def server(tmp_path):
    folder = tmp_path / "served"
    folder.mkdir()
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    handler.log_message = lambda *args: None
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield folder, f"http://127.0.0.1:{running.server_address[1]}"
        running.shutdown()


def tanks_archive(file, seed):
    """An archive like the official one, and its signals."""
    rng = np.random.default_rng(seed)
    content = {key: rng.normal(size=(1024, 1)) for key in ("uEst", "yEst", "uVal", "yVal")}
    mat = io.BytesIO()
    savemat(mat, {**content, "Ts": np.array([[4.0]])})
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("CascadedTanksFiles/dataBenchmark.mat", mat.getvalue())
    return content


def test_an_archive_is_fetched_once_and_converted(server, tmp_path, monkeypatch):
    pytest.importorskip("pooch")
    folder, address = server
    content = tanks_archive(folder / "tanks.zip", 0)
    known(monkeypatch, "_TANKS", content)
    tanks = fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/tanks.zip")
    np.testing.assert_array_equal(tanks.yVal, content["yVal"][:, 0])
    (folder / "tanks.zip").unlink()
    again = fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/tanks.zip")
    np.testing.assert_array_equal(again.uEst, tanks.uEst)
    file = tmp_path / "home" / "cascaded_tanks" / "cascaded_tanks.npz"
    assert list(file.parent.iterdir()) == [file]
    np.savez(file, **{**{key: value.ravel() for key, value in content.items()}, "yVal": tanks.yVal[::-1], "Ts": [4.0]})
    with pytest.raises(DataError, match="is damaged"):
        fetch_cascaded_tanks(tmp_path / "home")


def test_a_download_with_other_numbers_is_refused_and_not_kept(server, tmp_path, monkeypatch):
    pytest.importorskip("pooch")
    folder, address = server
    content = tanks_archive(folder / "right.zip", 0)
    tanks_archive(folder / "other.zip", 1)
    known(monkeypatch, "_TANKS", content)
    with pytest.raises(DataError, match=r"other\.zip holds other numbers than the known recording .*nothing is kept"):
        fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/other.zip")
    assert not list((tmp_path / "home" / "cascaded_tanks").iterdir())
    tanks = fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/right.zip")  # nothing of the other is read again
    np.testing.assert_array_equal(tanks.yVal, content["yVal"][:, 0])
    np.savetxt(folder / "exchanger.dat", np.ones((4000, 3)))
    with pytest.raises(DataError, match="holds other numbers than the known recording"):
        fetch_heat_exchanger(tmp_path / "home", url=f"{address}/exchanger.dat")


@pytest.mark.skipif(not SHARED.exists(), reason="the real recordings are not on this machine")
@pytest.mark.parametrize("name", ["_TANKS", "_SILVERBOX", "_EXCHANGER"])
def test_the_known_numbers_are_those_of_the_known_files(name):
    source = getattr(_recordings, name)
    file = {"_TANKS": "cascaded_tanks/cascaded_tanks", "_SILVERBOX": "silverbox/silverbox_SNLS80mV"}.get(name)
    arrays = dict(np.load(SHARED / f"{file or 'heat_exchanger/heat_exchanger'}.npz"))
    assert _recordings._numbers(arrays, source.signals) == source.numbers
    rounded = {key: np.round(arrays[key], 12) for key in source.signals}
    assert _recordings._numbers(rounded, source.signals) == source.numbers
    rounded[source.signals[0]][100] += 0.01
    assert _recordings._numbers(rounded, source.signals) != source.numbers


def test_a_broken_archive_and_no_server_are_said_so(server, tmp_path):
    pytest.importorskip("pooch")
    folder, address = server
    (folder / "half.zip").write_bytes(b"PK\x03\x04 broken off")
    with pytest.raises(DataError, match="did not give the archive"):
        fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/half.zip")
    with pytest.raises(DataError, match="could not download"):
        fetch_cascaded_tanks(tmp_path / "home", url=f"{address}/nothing.zip")


BALLS = b"ball,drop,time_s,height_m,velocity_m_s\ngolf,1,0.0,48.0,0.0\n"


def test_a_file_of_this_computer_is_an_address_as_the_message_says(tmp_path):
    own = tmp_path / "my drops.csv"
    own.write_bytes(BALLS)
    assert fetch_ball_drops(tmp_path / "home", url=own.as_uri()).height.tolist() == [48.0]
    assert own.exists()  # it is the user's
    with pytest.raises(DataError, match=r"there is no file .*nowhere"):
        fetch_ball_drops(tmp_path / "empty", url=(tmp_path / "nowhere").as_uri())


@pytest.mark.parametrize(
    "content",
    [b"<html>404</html>", b"", BALLS[:40], BALLS.replace(b"48.0", b"high"), BALLS.replace(b"48.0", b"nan"), BALLS + b"g\xfflf,1,0,1,0\n"],
)  # fmt: skip
def test_a_wrong_download_of_balls_is_not_kept(content, tmp_path):
    wrong, right = tmp_path / "wrong", tmp_path / "right"
    wrong.write_bytes(content)
    right.write_bytes(BALLS)
    with pytest.raises(DataError, match=r"has not the columns .* give url= of the right file"):
        fetch_ball_drops(tmp_path / "home", url=wrong.as_uri())
    assert fetch_ball_drops(tmp_path / "home", url=right.as_uri()).height.tolist() == [48.0]


def mat(**content):
    stream = io.BytesIO()
    savemat(stream, content)
    return stream.getvalue()


@pytest.mark.parametrize("content", [b"garbage", b"", mat(other=1.0), mat(uEst="text", yEst=1.0, uVal=1.0, yVal=1.0)])
def test_an_archive_with_another_member_is_refused_in_words(content, tmp_path):
    file = tmp_path / "archive.zip"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("dataBenchmark.mat", content)
    with pytest.raises(DataError, match=r"is not the official archive .* give url= of the right one"):
        fetch_cascaded_tanks(tmp_path / "home", url=file.as_uri())
    assert not [path for path in (tmp_path / "home").rglob("*") if path.is_file()]


@pytest.mark.parametrize("rate", [99.0, None])
def test_the_sample_time_is_known_and_not_read(rate, tmp_path, monkeypatch):
    signals = {name: np.arange(1024.0) for name in ("uEst", "yEst", "uVal", "yVal")}
    known(monkeypatch, "_TANKS", signals)
    (tmp_path / "cascaded_tanks").mkdir()
    np.savez(
        tmp_path / "cascaded_tanks" / "cascaded_tanks.npz",
        **signals,
        **({} if rate is None else {"Ts": np.array([rate])}),
    )
    assert fetch_cascaded_tanks(tmp_path).Ts == 4.0


def test_a_home_that_is_a_file_is_said(tmp_path):
    file = tmp_path / "home"
    file.write_text("x")
    with pytest.raises(DataError, match=r"data_home: the folder .* cannot be made"):
        fetch_cascaded_tanks(file, url="file:///nowhere.zip")


def test_the_drops_of_a_file_are_its_lines():
    lines = ["Golf Ball,1,0.0,48.0,0.1", "Golf Ball,2,0.5,47.0,-0.2", "Wiffle Ball,3,1.0,46.0,-3.0"]
    ball, drop, numbers = _drops("\n".join([",".join(_BALLS_COLUMNS), *lines, ""]).encode(), "here")
    assert ball.tolist() == ["Golf Ball", "Golf Ball", "Wiffle Ball"] and drop.tolist() == [1, 2, 3]
    assert numbers.tolist() == [[0.0, 0.5, 1.0], [48.0, 47.0, 46.0], [0.1, -0.2, -3.0]]
