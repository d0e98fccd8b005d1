"""A ROS 2 node that translates Holdfast's telemetry and takes goals: ros2_node.py NAME ENDPOINT.

NAME is the vehicle's name, ENDPOINT Zenoh's address (tcp/127.0.0.1:7447) or a file of `holdfast keys`.
Not tried with ROS 2: docs/ros2.md.
"""

import json
import math
import sys

import rclpy
import zenoh
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_msgs.msg import String

UNKNOWN = 1e6


class Holdfast(Node):
    """Publishes `odom` and `supervisor_state`, and sends each `goal_pose` as a goto."""

    def __init__(self, session, vehicle):
        super().__init__("holdfast")
        self.session, self.root = session, f"holdfast/{vehicle}"
        self.odometry = self.create_publisher(Odometry, "odom", 10)
        self.state = self.create_publisher(String, "supervisor_state", 10)
        self.create_subscription(PoseStamped, "goal_pose", self.go, 10)
        self.subscribers = [
            session.declare_subscriber(f"{self.root}/state", self.take_state),
            session.declare_subscriber(f"{self.root}/supervisor", self.take_supervisor),
        ]

    def take_state(self, sample):
        """Publish a state in ROS 2's frames (REP 103): east, north, up; forward, left, up."""
        state = json.loads(sample.payload.to_bytes())
        message = Odometry()
        message.header.stamp = self.get_clock().now().to_msg()
        message.header.frame_id, message.child_frame_id = "odom", "base_link"
        pose, twist = message.pose.pose, message.twist.twist
        pose.position.x, pose.position.y, pose.position.z = state["y_m"], state["x_m"], -state["depth_m"]
        turn = quaternion(state["roll_rad"], state["pitch_rad"], state["heading_rad"])
        pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = turn
        north, east = state["x_rate_mps"], state["y_rate_mps"]
        cos, sin = math.cos(state["heading_rad"]), math.sin(state["heading_rad"])
        twist.linear.x, twist.linear.y = north * cos + east * sin, north * sin - east * cos
        twist.linear.z = -state["depth_rate_mps"]  # level: roll and pitch are small while it is held
        twist.angular.x, twist.angular.y = state["roll_rate_radps"], -state["pitch_rate_radps"]
        twist.angular.z = -state["heading_rate_radps"]
        for row, name in ((0, "y_m"), (7, "x_m"), (14, "depth_m"), (35, "heading_rad")):
            message.pose.covariance[row] = UNKNOWN if name in state["absent"] else 1e-4
        self.odometry.publish(message)

    def take_supervisor(self, sample):
        """Publish the supervisor's state."""
        self.state.publish(String(data=json.loads(sample.payload.to_bytes())["state"]))

    def go(self, goal):
        """Send a goal as a goto, and log the answer."""
        turn, place = goal.pose.orientation, goal.pose.position
        yaw = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))
        heading_deg = math.degrees(math.remainder(0.5 * math.pi - yaw, 2.0 * math.pi))
        wanted = {"x_m": place.y, "y_m": place.x, "depth_m": -place.z, "heading_deg": heading_deg}
        for reply in self.session.get(f"{self.root}/command/goto", payload=json.dumps(wanted), timeout=8.0):
            self.get_logger().info((reply.ok or reply.err).payload.to_string())


def quaternion(roll_rad, pitch_rad, heading_rad):
    """Return x, y, z, w of forward, left, up in east, north, up."""
    half = (0.5 * roll_rad, -0.5 * pitch_rad, 0.5 * (0.5 * math.pi - heading_rad))
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def configuration(endpoint):
    """Return Zenoh's configuration of a client at an address, or that of a file."""
    if endpoint.endswith((".json5", ".json")):
        return zenoh.Config.from_file(endpoint)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    return config


def main(vehicle, endpoint):
    """Run until Ctrl-C."""
    rclpy.init()
    with zenoh.open(configuration(endpoint)) as session:
        node = Holdfast(session, vehicle)
        try:
            rclpy.spin(node)
        except KeyboardInterrupt:
            pass
        node.destroy_node()


if __name__ == "__main__":
    main(*sys.argv[1:])
