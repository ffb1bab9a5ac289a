"""The pair over Cyclone DDS, as ROS 2 would: topics `rt/…`, reliable commands, best-effort images."""

import time

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from ros_nodes.bus import Role, Stamp
from ros_nodes.messages import Header, Image, Time, Twist, TwistStamped, Vector3

_BATCH = 64
_RELIABLE = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))
_SENSOR_DATA = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5))
_STILL = Twist(linear=Vector3(x=0.2, y=0.0, z=0.0), angular=Vector3(x=0.0, y=0.0, z=0.1))


class DdsBus:
    def __init__(self, role: Role, *, domain: int) -> None:
        # Where discovery happens is said by CYCLONEDDS_URI, which the library reads itself.
        self._participant = DomainParticipant(domain)
        commands = Topic(self._participant, "rt/cmd_vel", TwistStamped)
        states = Topic(self._participant, "rt/robot_state", TwistStamped)
        images = Topic(self._participant, "rt/camera/image_raw", Image)
        outgoing, incoming = (commands, states) if role == "operator" else (states, commands)
        self._writer = DataWriter(self._participant, outgoing, qos=_RELIABLE)
        self._reader = DataReader(self._participant, incoming, qos=_RELIABLE)
        self._camera = DataWriter(self._participant, images, qos=_SENSOR_DATA) if role == "robot" else None
        self._screen = DataReader(self._participant, images, qos=_SENSOR_DATA) if role == "operator" else None
        self._waiting = WaitSet(self._participant)
        self._waiting.attach(ReadCondition(self._reader, ViewState.Any | InstanceState.Alive | SampleState.NotRead))

    def connected(self) -> bool:
        return bool(self._writer.get_matched_subscriptions() and self._reader.get_matched_publications())

    def send(self, stamp: Stamp) -> None:
        self._writer.write(TwistStamped(header=_header(stamp), twist=_STILL))

    def take(self, timeout_s: float) -> list[Stamp]:
        self._waiting.wait(duration(microseconds=max(int(timeout_s * 1e6), 1)))
        # A writer that was lost leaves samples without content behind.
        return [_stamp(each.header) for each in self._reader.take(_BATCH) if isinstance(each, TwistStamped)]

    def send_frame(self, size_bytes: int) -> None:
        if self._camera is not None:
            header = _header(Stamp(app="camera", number=0, sent_ns=time.monotonic_ns()))
            picture = bytes(size_bytes)
            self._camera.write(
                Image(
                    header=header,
                    height=1,
                    width=size_bytes,
                    encoding="mono8",
                    is_bigendian=0,
                    step=size_bytes,
                    data=picture,
                )
            )

    def take_frames(self) -> list[int]:
        samples = self._screen.take(_BATCH) if self._screen is not None else []
        return [len(each.data) for each in samples if isinstance(each, Image)]


def _header(stamp: Stamp) -> Header:
    seconds, nanoseconds = divmod(stamp.sent_ns, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=stamp.frame_id())


def _stamp(header: Header) -> Stamp:
    return Stamp.read(header.frame_id, header.stamp.sec * 1_000_000_000 + header.stamp.nanosec)
