"""Live: frames from a video, a folder and a camera; the newest is translated, the rest dropped."""

import json
import os
import threading
import time

import cv2
import numpy as np
import pytest
from PIL import Image
from waiting import wait_until

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.frame_order import FrameOrder
from t2twin.live import sources
from t2twin.live.follow import RepeatedRows, follow
from t2twin.live.sources import Frame, LatestFrame, open_source

pytestmark = pytest.mark.filterwarnings("ignore::t2twin.core.errors.T2TwinWarning")

HZ, FRAMES = 30.0, 24


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


def listed(count, more=lambda number: None):
    """A source of frames, each of which waits for `more`."""
    for number in range(count):
        more(number)
        yield Frame(frame(number), number, None, time.perf_counter())


def following(source):
    """The next frame of a source, None after the last."""
    return next(filter(None, source), None)


@pytest.fixture
def no_waiting(monkeypatch):
    """A clock that moves by what the test's thread sleeps: the pauses, s. A source of an earlier
    test may still poll in its own thread."""
    slept, own = [], threading.get_ident()

    class Clock:
        @staticmethod
        def perf_counter():
            return sum(slept)

        monotonic = perf_counter

        @staticmethod
        def sleep(seconds):
            if threading.get_ident() == own:
                slept.append(seconds)
            else:
                time.sleep(seconds)

    monkeypatch.setattr("t2twin.live.sources.time", Clock)
    return slept


def write(path, image, modified_s):
    Image.fromarray(image).save(path)
    os.utime(path, (modified_s, modified_s))


def grey(image):
    return round((float(image.mean()) - 40) / 8)


# Sources


def test_a_video_s_frames_arrive_as_if_it_were_played(video, no_waiting):
    source = open_source(str(video))
    frames = []
    while (each := following(source)) is not None:
        assert sum(no_waiting) >= each.arrived_s
        frames.append(each)
    assert sum(no_waiting) == pytest.approx((FRAMES - 1) / HZ)
    assert [each.number for each in frames] == [grey(each.image) for each in frames]
    assert [each.number for each in frames] == list(range(FRAMES))
    assert frames[0].image.shape == (320, 240, 3)


@pytest.mark.parametrize("turn_deg, corner", [(0, (0, 0)), (90, (0, -1)), (270, (-1, 0))])
@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("bgr", [False, True])
def test_frames_are_put_upright(turn_deg, corner, mirror, bgr, tmp_path):
    image = np.zeros((24, 32, 3), np.uint8)
    image[0, 0] = 3, 2, 1
    Image.fromarray(image).save(tmp_path / "a.png")
    seen = following(open_source(str(tmp_path), FrameOrder(turn_deg, mirror, bgr)))
    assert seen is not None
    upright = seen.image[:, ::-1] if mirror else seen.image
    assert upright[corner].tolist() == ([1, 2, 3] if bgr else [3, 2, 1])
    assert upright.shape == ((24, 32, 3) if turn_deg == 0 else (32, 24, 3))


@pytest.mark.parametrize("name, value", [("bgr", "no"), ("mirror", 1), ("turn_deg", 90.0),
                                         ("turn_deg", "90"), ("turn_deg", 45)])  # fmt: skip
def test_what_is_no_order_is_refused(name, value, tmp_path):
    with pytest.raises(T2TwinError, match=f"{name} is .*; expected"):
        FrameOrder(**{name: value})
    with pytest.raises(T2TwinError, match="order is None of type NoneType; expected"):
        open_source(str(tmp_path), None)  # pyright: ignore[reportArgumentType]


def test_colors_are_red_green_blue(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 60, (64, 64))
    writer.write(np.full((64, 64, 3), (10, 10, 240), np.uint8))  # OpenCV has blue first
    writer.release()
    seen = following(open_source(str(tmp_path / "v.avi")))
    assert seen is not None
    assert seen.image[..., 0].mean() > 200 > 60 > seen.image[..., 2].mean()


def test_a_folder_gives_its_newest_and_then_what_arrives(tmp_path):
    for number in range(3):
        write(tmp_path / f"{number}.png", frame(number), 1000 + number)
    (tmp_path / "notes.txt").write_text("no image")
    source = open_source(str(tmp_path))
    first = following(source)
    assert first is not None and first.name == "2.png"
    write(tmp_path / "9.png", frame(9), 1010)
    second = following(source)
    assert second is not None and (second.name, grey(second.image)) == ("9.png", 9)
    assert [first.number, second.number] == [0, 1]


def test_a_half_written_frame_is_read_again(tmp_path):
    write(tmp_path / ".9.png", frame(9), 1010)
    content = (tmp_path / ".9.png").read_bytes()
    source = open_source(str(tmp_path))
    (tmp_path / "9.png").write_bytes(content[: len(content) // 2])
    assert next(source) is None
    (tmp_path / "9.png").write_bytes(content)
    seen = following(source)
    assert seen is not None and grey(seen.image) == 9


def test_a_file_written_again_is_a_new_frame(tmp_path):
    source = open_source(str(tmp_path))
    for number in range(5):
        Image.fromarray(frame(number)).save(tmp_path / ".new.png")
        (tmp_path / ".new.png").replace(tmp_path / "latest.png")
        seen = following(source)
        assert seen is not None and (seen.number, grey(seen.image)) == (number, number)


def test_a_file_that_stays_broken_is_skipped_and_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "READ_TIMEOUT_S", 0.0)
    reports = []
    source = open_source(str(tmp_path), report=reports.append)
    (tmp_path / "a.png").write_text("no image")
    write(tmp_path / "b.png", frame(3), 1000)  # older, and whole
    first = following(source)
    assert first is not None and first.name == "b.png"
    assert next(source) is None
    assert len(reports) == 1 and "a.png cannot be read as an image" in reports[0]


# The newest


def test_a_slow_taker_gets_the_newest_frame():
    took = threading.Event()

    def more(number):
        if number == 30:  # twenty-nine came meanwhile
            took.wait()

    newest = LatestFrame(listed(50, more))
    wait_until(lambda: newest.read == 30)
    first = newest.take()
    took.set()
    wait_until(lambda: newest.ended)
    last = newest.take(29)
    taken = [each and each.number for each in (first, last, newest.take(49))]
    assert taken == [29, 49, None] and newest.read == 50


# Lines


def test_each_line_has_the_counts_of_its_frame(run, video):
    lines, said, before_s = [], [], time.time()
    ended = follow(run, open_source(str(video)), lines.append, said.append)
    records = [json.loads(line) for line in lines]
    assert ended == (len(records), FRAMES)
    numbers = [record["frame"] for record in records]
    assert numbers == sorted(set(numbers)) and numbers[-1] == FRAMES - 1
    decoded = {each.number: each.image for each in filter(None, open_source(str(video)))}
    for record in records:
        expected = np.rint(run.predict(decoded[record["frame"]])).astype(int)
        assert record["counts"] == expected.tolist()
        assert record["latency_ms"] > 0 and record["in_distribution"] is None
        assert before_s <= record["time_s"] <= time.time()
    assert f"{FRAMES - len(records)} of {FRAMES} dropped" in said[-1]
    assert "frames/s" in said[-1] and "latency" in said[-1]


def test_the_command_writes_lines_and_says_its_pace(untrained_runs, video, capsys):
    main(["live", "--run", str(untrained_runs[1]), str(video), "--frames", "3"])
    said = capsys.readouterr()
    assert [len(json.loads(line)["counts"]) for line in said.out.splitlines()] == [20] * 3
    assert said.err.startswith("t2twin: ") and "frames/s" in said.err


def test_a_stream_that_is_frozen_in_part_is_reported_once():
    rng, said = np.random.default_rng(0), []
    rows_of = RepeatedRows(said.append)
    noisy = [rng.integers(90, 99, (320, 240, 3), np.uint8) for _ in range(14)]
    noisy[12][160:], noisy[13][160:] = noisy[11][160:], noisy[11][160:]
    noisy = [np.vstack([np.zeros_like(image[:20]), image[20:]]) for image in noisy]  # a dark edge
    found = [rows_of(Frame(image, n, None, 0.0)) for n, image in enumerate(noisy)]
    assert found == [0] * 12 + [160, 160]
    assert len(said) == 1 and "frame 12 repeats 160 of 320 rows" in said[0]


def test_a_frame_unlike_the_training_is_reported_once(run):
    said, lines = [], []

    def wide():
        for number in range(5):
            wait_until(lambda number=number: len(lines) >= number)
            yield Frame(np.full((100, 400, 3), 90, np.uint8), number, None, time.perf_counter())

    follow(run, wide(), lines.append, said.append)
    assert len(lines) == 5
    assert all(json.loads(line)["in_distribution"] is False for line in lines)
    assert sum("unlike all training images" in each or "aspect" in each for each in said) == 1


def test_a_field_run_gives_standard_deviations_and_force():
    run = t2twin.load("field")
    lines, background = [], np.full((64, 48, 3), 90, np.uint8)
    follow(run, listed(1), lines.append, str, background=background)
    record, size = json.loads(lines[0]), run.config.preset.size
    small = run.pixels_of(background)[0]
    assert small.shape == (size, size, 3)
    expected = run.estimate(frame(0), small)
    assert record["counts"] == np.rint(expected.counts).astype(int).tolist()
    assert record["counts_std"] == np.rint(expected.counts_std).astype(int).tolist()
    assert expected.force_n is not None and expected.force_std_n is not None
    assert record["force_n"] == pytest.approx(float(expected.force_n), abs=1e-3)
    assert record["force_std_n"] == pytest.approx(float(expected.force_std_n), abs=1e-3)
