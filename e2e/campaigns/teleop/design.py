"""Decides which arm is deployed when, and in which condition: the design of docs/evaluation/eo2-protocol.md. Pure."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from typing import Final

from robotapp_testbed.machines.network import CLOUD_MS, FAR_MS, NEAR_MS

ROBOT, NEAR, FAR, CLOUD = "amr-07", "edge-1", "edge-2", "cloud-1"
OPERATOR_NODES: Final = (NEAR, FAR, CLOUD)
"""Where the operator side may go."""
RTT_MS: Final = {
    (ROBOT, NEAR): NEAR_MS,
    (ROBOT, FAR): FAR_MS,
    (ROBOT, CLOUD): CLOUD_MS,
    (NEAR, FAR): FAR_MS,
    (NEAR, CLOUD): CLOUD_MS,
    (FAR, CLOUD): CLOUD_MS,
}
WORSE_LINK: Final = {"delay_ms": 30.0, "jitter_ms": 10.0, "loss": 0.01}
"""One way between the robot and the near node, while the link is worse."""
LINK_AS_SET: Final = {"delay_ms": NEAR_MS / 2, "jitter_ms": 0.0, "loss": 0.0}
BUDGET_MS: Final = 30.0
DEADLINE_MS: Final = 50.0
ROUNDS: Final = 4
SEED: Final = 20261129
_LINKS: Final = (False, False, False, True)


class Arm(StrEnum):
    KUBE_SCHEDULER = "kube-scheduler"
    AFFINITY = "affinity"
    OURS = "ours"


ARMS: Final = tuple(Arm)


@dataclass(frozen=True, slots=True, order=True)
class Condition:
    """State of the site during a block. `ros` is the generation, 1 or 2."""

    ros: int
    ballast: bool
    worse_link: bool

    @property
    def disturbance(self) -> str:
        parts = [*(["ballast"] if self.ballast else []), *(["worse link"] if self.worse_link else [])]
        return " and ".join(parts) or "undisturbed"

    def keeps_budget(self, node: str) -> bool:
        """Returns whether the round trip that is set between the robot and a node is within the budget."""
        if node == NEAR and self.worse_link:
            return 2 * WORSE_LINK["delay_ms"] <= BUDGET_MS
        return node == ROBOT or RTT_MS[ROBOT, node] <= BUDGET_MS


@dataclass(frozen=True, slots=True)
class Turn:
    """One deployment to be made. Numbers count from 1."""

    number: int
    block: int
    condition: Condition
    arm: Arm


def plan_turns(seed: int, rounds: int = ROUNDS) -> list[Turn]:
    """Returns all deployments in their order: in each round every condition in its proportion, in each block every arm."""
    order = random.Random(seed)
    turns: list[Turn] = []
    for _ in range(rounds):
        conditions = [Condition(*levels) for levels in product((2, 1), (False, True), _LINKS)]
        order.shuffle(conditions)
        for condition in conditions:
            turns += _plan_block(condition, order, turns)
    return turns


def _plan_block(condition: Condition, order: random.Random, before: Sequence[Turn]) -> list[Turn]:
    arms = list(ARMS)
    order.shuffle(arms)
    block = len(before) // len(ARMS) + 1
    return [Turn(len(before) + place, block, condition, arm) for place, arm in enumerate(arms, start=1)]
