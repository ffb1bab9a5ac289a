"""What a node of the pair needs of its middleware."""

from dataclasses import dataclass
from typing import Literal, Protocol

Role = Literal["operator", "robot"]


@dataclass(frozen=True, slots=True)
class Stamp:
    """What travels in a message's header: which app's command it is, its number, and when it was sent (the sender's clock)."""

    app: str
    number: int
    sent_ns: int

    def frame_id(self) -> str:
        return f"{self.app}#{self.number}"

    @classmethod
    def read(cls, frame_id: str, sent_ns: int) -> "Stamp":
        app, _, number = frame_id.rpartition("#")
        return cls(app=app, number=int(number) if number.isdecimal() else -1, sent_ns=sent_ns)


class Bus(Protocol):
    """The operator publishes /cmd_vel and hears /robot_state and the camera; the robot the other way round."""

    def connected(self) -> bool:
        """The other end was discovered, in both directions."""
        ...

    def send(self, stamp: Stamp) -> None: ...

    def take(self, timeout_s: float) -> list[Stamp]:
        """Messages that came since the last call; waits for one, at most `timeout_s`."""
        ...

    def send_frame(self, size_bytes: int) -> None: ...

    def take_frames(self) -> list[int]:
        """Sizes of the camera images that came since the last call."""
        ...
