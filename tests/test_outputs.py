"""Outputs of live predictions and touches: ZeroMQ, Rerun, and the node of ROS 2 with stand-ins."""

import json
import runpy
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import zmq
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.live.follow import published, recorded
from t2twin.live.sources import Frame
from t2twin.rerun_log import RerunLog
from t2twin.translate.inference.estimate import ContactEstimate

EXAMPLES = Path(__file__).parents[1] / "examples"
LINE = {"frame": 0, "counts": [1, 2, 3], "force_n": 2.5}
FRAME = Frame(np.zeros((4, 3, 3), np.uint8), 0, None, 1.0)


@pytest.fixture
def rerun(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """A stand-in for Rerun, which is not installed for tests."""
    module = MagicMock(spec=ModuleType("rerun"))
    module.__spec__ = MagicMock()
    for name in ("RecordingStream", "Image", "BarChart", "Scalars", "DepthImage"):
        setattr(module, name, MagicMock())
    monkeypatch.setitem(sys.modules, "rerun", module)
    return module


def test_subscribers_receive_each_line() -> None:
    address = f"ipc://{Path('socket').resolve()}"
    context = zmq.Context()
    subscriber = context.socket(zmq.SUB)
    with published(address, print) as publish:
        subscriber.connect(address)
        subscriber.subscribe("")
        while not subscriber.poll(10):  # a subscription takes effect after a while
            publish(FRAME, LINE, None)
        assert json.loads(subscriber.recv()) == LINE
        context.destroy(linger=0)


@pytest.mark.parametrize("address", ["", "tcp://256.0.0.1:1", "tcp://127.0.0.1:99999"])
def test_bad_addresses_are_refused(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(T2TwinError, match="cannot be bound"):
        published(address, print).__enter__()
    with published("tcp://127.0.0.1:*", print):
        assert "at tcp://127.0.0.1:" in capsys.readouterr().out


def test_a_touch_is_recorded(rerun: MagicMock) -> None:
    log = RerunLog(Path("new/touch.rrd"))
    touch = t2twin.press("square-2", force_n=2)
    log.touch(0.5, touch)
    log.close()
    stream = rerun.RecordingStream.return_value
    stream.save.assert_called_once_with(Path("new/touch.rrd"))
    stream.set_time.assert_called_once_with("time", duration=0.5)
    logged = [call.args[0] for call in stream.log.call_args_list]
    assert logged[:4] == ["digit/image", "cyskin-20/counts", "digit/force_n", "digit/depth_mm"]
    np.testing.assert_array_equal(rerun.Image.call_args.args[0], touch.image)
    assert rerun.Scalars.call_args_list[0].args[0] == pytest.approx(2.0, rel=1e-3)


def test_predictions_are_recorded_from_the_first_frame_on(rerun: MagicMock) -> None:
    contact = MagicMock(spec=ContactEstimate, depth_mm=np.array([[-0.1, 0.7]]))
    with recorded(Path("live.rrd")) as record:
        record(FRAME, LINE, None)
        line = LINE | {"contact": {"largest_depth_mm": 0.7}}
        record(Frame(FRAME.image, 1, None, 3.5), line, contact)
    logged = [call.args[0] for call in rerun.RecordingStream().log.call_args_list]
    assert logged[-2:] == ["prediction/contact/largest_depth_mm", "prediction/contact/depth"]
    assert rerun.DepthImage.call_args.kwargs == {"meter": 1000.0}
    np.testing.assert_array_equal(rerun.DepthImage.call_args.args[0], [[0.0, 0.7]])
    times = [call.kwargs["duration"] for call in rerun.RecordingStream().set_time.call_args_list]
    assert times == [0.0, 2.5]


@pytest.mark.usefixtures("rerun")
def test_a_slide_is_recorded() -> None:
    line = "slide hemisphere-4 --force-n 2 --dx-mm 0.2 --steps 1 --rerun a.rrd"
    main([*line.split()])
    assert Path("a.rrd").exists()
    assert Path("runs/slide/hemisphere-4/slide.csv").exists()


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("t2twin.rerun_log.find_spec", lambda name: None)
    monkeypatch.setattr("t2twin.live.follow.find_spec", lambda name: None)
    with pytest.raises(T2TwinError, match=r"pip install 't2twin\[rerun\]'"):
        RerunLog(Path("a.rrd"))
    with pytest.raises(T2TwinError, match=r"pip install 't2twin\[zmq\]'"):
        published("tcp://127.0.0.1:5555", print).__enter__()


class Node:
    """Stand-in for rclpy's Node."""

    published: dict[str, list[Any]]

    def __init__(self, name: str) -> None:
        Node.published = {}
        self.values: dict[str, object] = {"camera": "frames"}

    def declare_parameter(self, name: str, value: object) -> None:
        self.values.setdefault(name, value)

    def get_parameter(self, name: str) -> SimpleNamespace:
        return SimpleNamespace(value=self.values[name])

    def create_publisher(self, kind: type, topic: str, queue: int) -> SimpleNamespace:
        messages = Node.published.setdefault(topic, [])
        return SimpleNamespace(publish=messages.append)

    def get_clock(self) -> MagicMock:
        return MagicMock()


def test_the_ros_node_publishes_image_and_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    modules = {
        "rclpy": SimpleNamespace(
            init=lambda: None,
            ok=lambda: not any(Node.published["cyskin/force_n"]),
            spin_once=lambda node, timeout_sec: time.sleep(timeout_sec),
        ),
        "rclpy.node": SimpleNamespace(Node=Node),
        "sensor_msgs": SimpleNamespace(),
        "sensor_msgs.msg": SimpleNamespace(Image=MagicMock),
        "std_msgs": SimpleNamespace(),
        "std_msgs.msg": SimpleNamespace(Float32=SimpleNamespace, Float32MultiArray=SimpleNamespace),
    }
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    touch = t2twin.press("square-2", force_n=4)
    Path("frames").mkdir()
    Image.fromarray(touch.image).save("frames/0.png")
    runpy.run_path(str(EXAMPLES / "ros2_node.py"), run_name="__main__")
    (image,), (counts,) = Node.published["digit/image"], Node.published["cyskin/counts"]
    assert (image.height, image.width, image.step, image.encoding) == (320, 240, 720, "rgb8")
    assert image.data == touch.image.tobytes()
    np.testing.assert_allclose(counts.data, t2twin.load().predict(touch.image), atol=1.0)
