"""Blows come by the grant and not by the second, and who stands still goes on."""

import random
from typing import Any

from campaigns.storm.campaign import Misfortune


class Program:
    def __init__(self, name: str) -> None:
        self.name, self.running, self.still = name, True, False

    def kill(self) -> None:
        self.running = self.still = False

    def start(self) -> None:
        self.running = True

    def pause(self) -> None:
        self.still = True

    def resume(self) -> None:
        self.still = False

    def log_text(self) -> str:
        return "x: the answer was lost on purpose\n" * 2


def test_so_many_grants_are_one_blow_and_in_the_end_all_run() -> None:
    programs: Any = [Program(name) for name in "abcd"]
    misfortune = Misfortune(programs, every=10, chance=random.Random(1))
    for grants in range(0, 400, 2):
        misfortune.strike(grants)
    assert 20 <= misfortune.kills + misfortune.stops <= 39  # who stands still is not stopped again
    assert min(misfortune.kills, misfortune.stops) > 5
    misfortune.end()
    assert all(program.running and not program.still for program in programs)
    assert misfortune.lost_answers() == 8


def test_nobody_is_hurt_while_nothing_is_granted() -> None:
    programs: Any = [Program("a")]
    misfortune = Misfortune(programs, every=10, chance=random.Random(1))
    for _ in range(50):
        misfortune.strike(9)
    assert (misfortune.kills, misfortune.stops) == (0, 0)
