"""A ROS 2 node that publishes the frames of a DIGIT and the counts predicted from them.

python examples/ros2_node.py --ros-args -p camera:=0 -p background:=background.png

Topics: `digit/image` (sensor_msgs/Image, rgb8), `cyskin/counts` and `cyskin/counts_std`
(std_msgs/Float32MultiArray, one value per taxel), `cyskin/force_n` (std_msgs/Float32).
The node needs ROS 2 with rclpy, and the extras live and onnx of t2twin. It was tested with
stand-ins for rclpy and its messages only, not with ROS.
"""

# pyright: reportMissingImports=false
import numpy as np
import rclpy
from PIL import Image as Picture
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Float32, Float32MultiArray

import t2twin
from t2twin.core.frame_order import FrameOrder
from t2twin.live.sources import LatestFrame, open_source

QUEUE = 5  # messages that a topic keeps for slow subscribers


def image_message(image: np.ndarray) -> Image:
    """image: (h, w, 3) uint8, RGB."""
    message = Image()
    message.height, message.width = image.shape[:2]
    message.encoding, message.is_bigendian = "rgb8", 0
    message.step = 3 * image.shape[1]
    message.data = np.ascontiguousarray(image).tobytes()
    return message


class Translator(Node):
    """Translates each frame of a camera, and publishes image and counts."""

    def __init__(self) -> None:
        super().__init__("t2twin")
        self.declare_parameter("camera", "0")
        self.declare_parameter("turn_deg", 0)
        self.declare_parameter("run", "field")
        self.declare_parameter("background", "")
        self.run = t2twin.load(str(self.get_parameter("run").value))
        path = str(self.get_parameter("background").value)
        self.background = np.asarray(Picture.open(path).convert("RGB")) if path else None
        self.images = self.create_publisher(Image, "digit/image", QUEUE)
        self.counts = self.create_publisher(Float32MultiArray, "cyskin/counts", QUEUE)
        self.spread = self.create_publisher(Float32MultiArray, "cyskin/counts_std", QUEUE)
        self.force = self.create_publisher(Float32, "cyskin/force_n", QUEUE)

    def publish(self, image: np.ndarray) -> None:
        estimate = self.run.estimate(image, self.background)
        message = image_message(image)
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id = "digit"
        self.images.publish(message)
        self.counts.publish(Float32MultiArray(data=estimate.counts.tolist()))
        self.spread.publish(Float32MultiArray(data=estimate.counts_std.tolist()))
        if estimate.force_n is not None:
            self.force.publish(Float32(data=float(estimate.force_n)))


def main() -> None:
    rclpy.init()
    node = Translator()
    camera, turn_deg = (node.get_parameter(name).value for name in ("camera", "turn_deg"))
    latest, last = LatestFrame(open_source(str(camera), FrameOrder(turn_deg))), -1
    while rclpy.ok() and not (latest.ended and latest.take(last, 0.0) is None):
        frame = latest.take(last, timeout_s=0.1)
        if frame is not None:
            last = frame.number
            node.publish(frame.image)
        rclpy.spin_once(node, timeout_sec=0)
    latest.close()


if __name__ == "__main__":
    main()
