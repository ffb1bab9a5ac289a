"""The programs of the pair on a bus that answers from a script, with a clock that moves only while somebody waits."""

import io

import pytest

from ros_nodes.bus import Stamp
from ros_nodes.connect import connect
from ros_nodes.operator_node import OperatorNode
from ros_nodes.robot_node import RobotNode
from ros_nodes.trips import FOREIGN, FRAME, READY, SENT, TRIP, parse


class Loop:
    """Answers every command `delay_ns` later, some of them never; the clock is its own."""

    def __init__(self, *, delay_ns: int = 5_000_000, lost: tuple[int, ...] = ()) -> None:
        self.now_ns = 10**12
        self.delay_ns = delay_ns
        self.lost = lost
        self.sent: list[Stamp] = []
        self.frames: list[int] = []
        self.pending: list[tuple[int, Stamp]] = []
        self.asked_connected = 0

    def clock(self) -> int:
        return self.now_ns

    def seconds(self) -> float:
        return self.now_ns / 1e9

    def connected(self) -> bool:
        self.asked_connected += 1
        return self.asked_connected > 2

    def send(self, stamp: Stamp) -> None:
        self.sent.append(stamp)
        if stamp.number not in self.lost:
            self.pending.append((self.now_ns + self.delay_ns, stamp))

    def take(self, timeout_s: float) -> list[Stamp]:
        until_ns = self.now_ns + int(timeout_s * 1e9)
        due = [at for at, _ in self.pending if at <= until_ns]
        self.now_ns = max(self.now_ns, min(due)) if due else max(until_ns, self.now_ns + 1)
        found = [stamp for at, stamp in self.pending if at <= self.now_ns]
        self.pending = [(at, stamp) for at, stamp in self.pending if at > self.now_ns]
        return found

    def send_frame(self, size_bytes: int) -> None:
        self.frames.append(size_bytes)

    def take_frames(self) -> list[int]:
        found, self.frames = self.frames, []
        return found


def operator(bus: Loop, count: int = 10) -> io.StringIO:
    out = io.StringIO()
    OperatorNode(bus, app="mine", rate_hz=50, out=out, clock=bus.clock).run(count)
    return out


def test_commands_go_out_at_the_rate_and_every_answer_is_a_row() -> None:
    bus = Loop(lost=(4,))
    rows = parse(operator(bus).getvalue().splitlines())
    assert [row.at_us for row in rows if row.kind == SENT] == [number * 20_000 for number in range(10)]
    trips = {row.number: row.rtt_us for row in rows if row.kind == TRIP}
    assert trips == {number: 5000 for number in range(1, 10) if number != 4}


def test_messages_of_another_app_and_images_are_told_apart() -> None:
    bus = Loop()
    bus.pending.append((bus.now_ns + 1, Stamp(app="theirs", number=77, sent_ns=0)))
    bus.frames.append(640)
    rows = parse(operator(bus, 2).getvalue().splitlines())
    assert [row.number for row in rows if row.kind == FOREIGN] == [77]
    assert [row.number for row in rows if row.kind == FRAME] == [640]


def test_after_a_stop_of_the_machine_the_missed_commands_are_not_sent_at_once() -> None:
    bus = Loop()
    node = OperatorNode(bus, app="mine", rate_hz=50, out=io.StringIO(), clock=bus.clock)
    node.run(2)
    bus.now_ns += 2_000_000_000
    before_ns = bus.now_ns
    node.run(6)
    assert bus.now_ns - before_ns >= 2 * 20_000_000


def test_it_waits_until_it_is_connected_in_both_directions() -> None:
    bus = Loop()
    out = io.StringIO()
    pauses: list[float] = []
    OperatorNode(bus, app="mine", rate_hz=50, out=out, clock=bus.clock).wait_connected(pauses.append)
    assert len(pauses) == 2
    assert [row.kind for row in parse(out.getvalue().splitlines())] == [READY]


def test_the_robot_answers_with_the_stamp_it_got() -> None:
    bus = Loop(lost=(1,))
    stamp = Stamp(app="mine", number=1, sent_ns=7)
    bus.pending.append((bus.now_ns, stamp))
    RobotNode(bus, camera_hz=0, camera_bytes=0, clock=bus.seconds).step()
    assert bus.sent == [stamp]
    assert bus.frames == []


def test_the_camera_keeps_its_rate() -> None:
    bus = Loop()
    node = RobotNode(bus, camera_hz=10, camera_bytes=640, clock=bus.seconds)
    until_s = bus.seconds() + 1.05
    while bus.seconds() < until_s:
        node.step()
    assert bus.frames == [640] * 11


@pytest.mark.parametrize("stamp", [Stamp("app", 7, 0), Stamp("a#b", 0, 5)])
def test_a_stamp_survives_the_header(stamp: Stamp) -> None:
    assert Stamp.read(stamp.frame_id(), stamp.sent_ns) == stamp
    assert Stamp.read("nonsense", 0).number == -1


def test_without_a_granted_domain_there_is_no_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("ROS_MASTER_URI", raising=False)
    with pytest.raises((KeyError, ModuleNotFoundError)):
        connect("robot")
