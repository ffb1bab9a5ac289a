"""The programs of the pair on a bus that answers from a script, with a clock that moves only while somebody waits."""

import io

from ros_nodes.bus import Stamp
from ros_nodes.operator_node import OperatorNode
from ros_nodes.trips import FOREIGN, FRAME, SENT, TRIP, parse


class Loop:
    """Answers every command `delay_ns` later, some of them never; the clock is its own."""

    def __init__(self, *, delay_ns: int = 5_000_000, lost: tuple[int, ...] = ()) -> None:
        self.now_ns = 10**12
        self.delay_ns = delay_ns
        self.lost = lost
        self.sent: list[Stamp] = []
        self.frames: list[int] = []
        self.pending: list[tuple[int, Stamp]] = []

    def clock(self) -> int:
        return self.now_ns

    def connected(self) -> bool:
        return True

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
