"""The pair over ROS 1: real rospy nodes, registered with the master the operator of RobotApp runs."""

import queue
from contextlib import suppress

import rospy
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import Image

from ros_nodes.bus import Role, Stamp


class RospyBus:
    def __init__(self, role: Role) -> None:
        rospy.init_node(f"teleop_{role}", disable_signals=True)
        outgoing, incoming = ("/cmd_vel", "/robot_state") if role == "operator" else ("/robot_state", "/cmd_vel")
        self._came: queue.SimpleQueue[Stamp] = queue.SimpleQueue()
        self._frames: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._publisher = rospy.Publisher(outgoing, TwistStamped, queue_size=10, tcp_nodelay=True)
        self._subscriber = rospy.Subscriber(incoming, TwistStamped, self._hear, tcp_nodelay=True)
        self._camera = rospy.Publisher("/camera/image_raw", Image, queue_size=1) if role == "robot" else None
        if role == "operator":
            rospy.Subscriber("/camera/image_raw", Image, self._see, queue_size=1, buff_size=2**24)

    def connected(self) -> bool:
        return bool(self._publisher.get_num_connections() and self._subscriber.get_num_connections())

    def send(self, stamp: Stamp) -> None:
        message = TwistStamped()
        message.header.frame_id = stamp.frame_id()
        message.header.stamp = rospy.Time(*divmod(stamp.sent_ns, 1_000_000_000))
        message.twist.linear.x = 0.2
        self._publisher.publish(message)

    def take(self, timeout_s: float) -> list[Stamp]:
        found: list[Stamp] = []
        with suppress(queue.Empty):
            found.append(self._came.get(timeout=timeout_s))
            while True:
                found.append(self._came.get_nowait())
        return found

    def send_frame(self, size_bytes: int) -> None:
        if self._camera is not None:
            self._camera.publish(
                Image(height=1, width=size_bytes, encoding="mono8", step=size_bytes, data=bytes(size_bytes))
            )

    def take_frames(self) -> list[int]:
        return [self._frames.get() for _ in range(self._frames.qsize())]

    def _hear(self, message: TwistStamped) -> None:
        self._came.put(Stamp.read(message.header.frame_id, message.header.stamp.to_nsec()))

    def _see(self, message: Image) -> None:
        self._frames.put(len(message.data))
