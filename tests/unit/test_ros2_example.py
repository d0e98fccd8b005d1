"""The node of docs/examples/ros2_node.py, with a stand-in for rclpy: there is no ROS 2 here."""

import importlib.util
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from dashboard.foxglove.poses import quaternion

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "ros2_node.py"
STATE = json.dumps(
    {
        "x_m": 3.0,
        "y_m": -1.0,
        "depth_m": 5.0,
        "roll_rad": 0.1,
        "pitch_rad": -0.2,
        "heading_rad": math.pi / 2,
        "x_rate_mps": 0.0,
        "y_rate_mps": 0.4,
        "depth_rate_mps": 0.1,
        "roll_rate_radps": 0.0,
        "pitch_rate_radps": 0.3,
        "heading_rate_radps": 0.2,
        "absent": ["x_m"],
    }
)


class Message:
    """Has every field that is asked for, as the messages of ROS 2 have theirs."""

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)

    def __getattr__(self, name: str) -> Any:
        value = [0.0] * 36 if name == "covariance" else Message()
        self.__dict__[name] = value
        return value


class Node:
    """What the example uses of rclpy's."""

    def __init__(self, name: str) -> None:
        self.published: dict[str, list[Any]] = {}

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        return SimpleNamespace(publish=self.published.setdefault(topic, []).append)

    def create_subscription(self, kind: type, topic: str, callback: Any, depth: int) -> None:
        self.goal = callback

    def get_clock(self) -> MagicMock:
        return MagicMock()

    def get_logger(self) -> MagicMock:
        return MagicMock()


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    stand_ins: dict[str, dict[str, type]] = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "geometry_msgs.msg": {"PoseStamped": Message},
        "nav_msgs.msg": {"Odometry": Message},
        "std_msgs.msg": {"String": Message},
    }
    for name, content in stand_ins.items():
        module = ModuleType(name)
        module.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, module)
        if "." in name and not name.startswith("rclpy"):
            monkeypatch.setitem(sys.modules, name.partition(".")[0], ModuleType(name.partition(".")[0]))
    spec = importlib.util.spec_from_file_location("ros2_node", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sample(text: str) -> MagicMock:
    made = MagicMock()
    made.payload.to_bytes.return_value = text.encode()
    return made


def test_a_state_comes_out_in_the_frames_of_ros(example: ModuleType) -> None:
    node = example.Holdfast(MagicMock(), "kelp")
    node.take_state(sample(STATE))
    (odometry,) = node.published["odom"]
    place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (place.x, place.y, place.z) == (-1.0, 3.0, -5.0)
    assert vars(turn) == pytest.approx(quaternion(0.1, -0.2, math.pi / 2))
    twist = odometry.twist.twist
    assert (twist.linear.x, twist.linear.y, twist.linear.z) == pytest.approx((0.4, 0.0, -0.1)), (
        "eastward, bow east"
    )
    assert (twist.angular.y, twist.angular.z) == (-0.3, -0.2)
    assert odometry.pose.covariance[7] > 1e5 > odometry.pose.covariance[0]


def test_a_goal_becomes_a_goto(example: ModuleType) -> None:
    session = MagicMock()
    session.get.return_value = []
    node = example.Holdfast(session, "kelp")
    turn = quaternion(0.0, 0.0, math.radians(-120.0))
    goal = SimpleNamespace(
        pose=SimpleNamespace(
            position=SimpleNamespace(x=2.0, y=1.0, z=-4.0), orientation=SimpleNamespace(**turn)
        )
    )
    node.goal(goal)
    (key,), given = session.get.call_args
    assert key == "holdfast/kelp/command/goto"
    assert json.loads(given["payload"]) == pytest.approx(
        {"x_m": 1.0, "y_m": 2.0, "depth_m": 4.0, "heading_deg": -120.0}
    )


def test_the_supervisor_s_state_is_text(example: ModuleType) -> None:
    node = example.Holdfast(MagicMock(), "kelp")
    node.take_supervisor(sample('{"state": "ACTIVE"}'))
    assert node.published["supervisor_state"][0].data == "ACTIVE"
