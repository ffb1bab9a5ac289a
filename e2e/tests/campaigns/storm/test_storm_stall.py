"""A storm in which nothing is granted any more is told apart from one on a slow machine."""

from campaigns.storm.campaign import STALL_S, STALL_WISHES, Stall


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_it_is_told_when_both_time_and_wishes_have_passed_without_a_grant() -> None:
    clock = Clock()
    stall = Stall(clock)
    assert stall.look(grants=5, wishes=100) == ""
    clock.now_s += STALL_S + 1
    assert stall.look(grants=5, wishes=100 + STALL_WISHES - 1) == "", "who is slow makes few wishes"
    told = stall.look(grants=5, wishes=100 + STALL_WISHES)
    assert told == f"after 5 grants nothing was granted for 61 s, while {STALL_WISHES} wishes came"
