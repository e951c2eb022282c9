"""Live: frames from a video, a folder and a camera; the newest is translated, the rest dropped."""

import io
import json
import sys
import threading
import time

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.live.follow import follow
from t2twin.live.newest import Newest
from t2twin.live.sources import Folder, Frame, Video, _opencv, open_source
from t2twin.primitives_cad.errors import T2TwinError

HZ, FRAMES = 30.0, 24
cv2 = _opencv()  # before anything else of it is used, as in the command, so that it is quiet


def frame(number):
    """A frame that is known by its grey, 40 and rising by 8."""
    return np.full((320, 240, 3), (40 + 8 * number) % 256, np.uint8)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    path = tmp_path_factory.mktemp("video") / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), HZ, (240, 320))
    assert writer.isOpened()
    for number in range(FRAMES):
        writer.write(frame(number))
    writer.release()
    return path


@pytest.fixture(scope="module")
def run(untrained_runs):
    return t2twin.load(untrained_runs[0])


class Listed:
    """A source of frames that are there at once, then ends."""

    def __init__(self, count, pause_s=0.0):
        self.left = [Frame(frame(n), n, None, time.perf_counter()) for n in range(count)]
        self.pause_s = pause_s

    def read(self):
        time.sleep(self.pause_s)
        return self.left.pop(0) if self.left else None


def grey(image):
    return round((float(image.mean()) - 40) / 8)


# Sources


def test_a_video_s_frames_arrive_as_if_it_were_played(video):
    source = open_source(str(video))
    started = time.perf_counter()
    frames = []
    while (each := source.read()) is not None:
        assert time.perf_counter() >= each.arrived_s
        frames.append(each)
    assert time.perf_counter() - started >= (FRAMES - 1) / HZ
    assert [each.number for each in frames] == [grey(each.image) for each in frames]
    assert [each.number for each in frames] == list(range(FRAMES))
    assert frames[0].image.shape == (320, 240, 3)


@pytest.mark.parametrize("turn_deg, corner", [(0, (0, 0)), (90, (0, -1)), (270, (-1, 0))])
def test_frames_are_turned_upright(turn_deg, corner, tmp_path):
    image = np.zeros((24, 32), np.uint8)
    image[0, 0] = 255
    Image.fromarray(image).save(tmp_path / "a.png")
    seen = Folder(tmp_path, turn_deg).read()
    assert seen is not None and seen.image[corner] == 255
    assert seen.image.shape == ((24, 32) if turn_deg == 0 else (32, 24))


def test_colours_are_red_green_blue(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 60, (64, 64))
    writer.write(np.full((64, 64, 3), (10, 10, 240), np.uint8))  # OpenCV has blue first
    writer.release()
    seen = Video(tmp_path / "v.avi").read()
    assert seen is not None
    assert seen.image[..., 0].mean() > 200 > 60 > seen.image[..., 2].mean()


def test_a_folder_gives_its_newest_and_then_what_arrives(tmp_path):
    for number in range(3):
        Image.fromarray(frame(number)).save(tmp_path / f"{number}.png")
        time.sleep(0.01)
    (tmp_path / "notes.txt").write_text("no image")
    source = Folder(tmp_path)
    first = source.read()
    assert first is not None and first.name == "2.png"
    buffer = io.BytesIO()
    Image.fromarray(frame(9)).save(buffer, "PNG")
    content = buffer.getvalue()

    def arrive():
        (tmp_path / "9.png").write_bytes(content[: len(content) // 2])  # half of it at first
        time.sleep(0.2)
        (tmp_path / "9.png").write_bytes(content)

    threading.Thread(target=arrive).start()
    second = source.read()
    assert second is not None and (second.name, grey(second.image)) == ("9.png", 9)
    assert [first.number, second.number] == [0, 1]


def test_a_file_that_stays_broken_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("t2twin.live.sources.PATIENCE_S", 0.05)
    (tmp_path / "a.png").write_text("no image")
    with pytest.raises(T2TwinError, match=r"a\.png cannot be read as an image"):
        Folder(tmp_path).read()


@pytest.mark.parametrize(
    "name, words",
    [("nowhere", "no source"), ("", "no source"), ("text.mp4", "as a video"), ("99", "camera 99")],
)
def test_what_gives_no_frames_is_refused(name, words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(T2TwinError, match=words):
        open_source(name)
    assert capfd.readouterr() == ("", "")  # nor does OpenCV say anything


def test_without_opencv_it_says_what_brings_it(video, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(T2TwinError, match=r"t2twin\[live\]"):
        open_source(str(video))


# The newest


def test_a_slow_taker_gets_the_newest_frame():
    newest = Newest(Listed(50, pause_s=0.002))
    taken = []
    while (each := newest.take(taken[-1] if taken else -1)) is not None:
        taken.append(each.number)
        time.sleep(0.02)
    assert taken == sorted(set(taken)) and taken[-1] == 49 and len(taken) < 25
    assert newest.read == 50 and newest.ended


def test_several_take_from_one_source():
    newest = Newest(Listed(3))
    while not newest.ended:
        time.sleep(0.001)
    both = [newest.take(1), newest.take(1)]
    assert [each and each.number for each in both] == [2, 2] and newest.take(2) is None


def test_a_source_s_error_comes_through():
    class Broken:
        def read(self):
            raise T2TwinError("the camera is gone")

    with pytest.raises(T2TwinError, match="gone"):
        Newest(Broken()).take()


# Lines


def test_each_line_has_the_counts_of_its_frame(run, video):
    lines, said = [], []
    pace = follow(run, open_source(str(video)), lines.append, said.append)
    records = [json.loads(line) for line in lines]
    assert pace.done == len(records) and pace.came == FRAMES
    numbers = [record["frame"] for record in records]
    assert numbers == sorted(set(numbers)) and numbers[-1] == FRAMES - 1
    decoded = {each.number: each.image for each in iter(Video(video).read, None)}
    for record in records:
        expected = np.rint(run.predict(decoded[record["frame"]])).astype(int)
        assert record["counts"] == expected.tolist()
        assert record["latency_ms"] > 0 and record["like_training"] is True
        assert abs(record["time_s"] - time.time()) < 60
    assert f"{FRAMES - len(records)} of {FRAMES} dropped" in said[-1]
    assert "frames/s" in said[-1] and "latency" in said[-1]


def test_the_command_writes_lines_and_says_its_pace(untrained_runs, video, capsys):
    main(["live", str(untrained_runs[1]), str(video), "--frames", "3"])
    said = capsys.readouterr()
    assert [len(json.loads(line)["counts"]) for line in said.out.splitlines()] == [20] * 3
    assert said.err.startswith("t2twin: ") and "frames/s" in said.err


@pytest.mark.parametrize(
    "arguments, words",
    [
        (("nowhere", "video"), "nowhere"),
        (("{run}", "nowhere"), "no source"),
        (("{run}", "{video}", "--frames", "0"), "--frames"),
        (("{run}", "{video}", "--layout", "none"), "layout"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: tuple[str, ...], words, untrained_runs, video, capsys
):
    places = {"{run}": str(untrained_runs[0]), "{video}": str(video)}
    with pytest.raises(SystemExit) as stop:
        main(["live", *[places.get(word, word) for word in arguments]])
    said = capsys.readouterr()
    assert stop.value.code == 2 and said.out == ""
    assert words in said.err and said.err.count("\n") == 1


def test_a_frame_unlike_the_training_is_said_once(run, monkeypatch):
    said, lines = [], []
    monkeypatch.setattr(type(run), "is_familiar", lambda self, pixels: np.zeros(len(pixels), bool))
    follow(run, Listed(5, pause_s=0.05), lines.append, said.append)
    assert all(json.loads(line)["like_training"] is False for line in lines)
    assert sum("unlike all" in sentence for sentence in said) == 1
