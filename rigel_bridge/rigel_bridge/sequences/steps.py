"""What a sequence of a Rigelfile stands for, step by step. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from hashlib import sha256
from typing import Final

from rigel_bridge.document.failures import BridgeError, control_character
from rigel_bridge.document.naming import MAX_APP_NAME, label
from rigel_bridge.generations.model import Generation, Rigelfile, Step

_DEPLOY: Final = "deploy"
BUILD: Final = (("create",), ("build", "--push"))
"""Of a list of packages: Dockerfiles, then images, which the cluster's nodes pull from the registry."""
_SCHEDULER: Final = frozenset({"scheduler_name", "buildargs"})
"""Overrides of a build that are meant for the deployment: the image is the same for every scheduler."""


class Kind(StrEnum):
    DEPLOY = "deploy"
    """Done by the bridge."""
    RIGEL = "rigel"
    """Done by Rigel itself."""


@dataclass(frozen=True, slots=True)
class Action:
    """One step. `commands` are the arguments of each call of Rigel."""

    kind: Kind
    job: str
    commands: tuple[tuple[str, ...], ...] = ()
    note: str = ""


def actions(rigelfile: Rigelfile, sequence: str) -> list[Action]:
    """The steps of a sequence in order. Several deploying jobs become one step, at the place of the first: they run together."""
    found: list[Action] = []
    for step in rigelfile.sequences[sequence]:
        action = _action(rigelfile, step)
        if action not in found:
            found.append(action)
    return found


def _action(rigelfile: Rigelfile, step: Step) -> Action:
    if step.job in rigelfile.jobs or step.job == _DEPLOY:
        return Action(Kind.DEPLOY, _DEPLOY)
    if step.job.startswith("-"):
        raise step.node.fail(f"{step.job[:80]!r} would be a flag of `rigel run job`: give the job another name")
    commands = BUILD if rigelfile.generation is Generation.G1 else (("run", "job", step.job),)
    return Action(Kind.RIGEL, step.job, commands, _lost(step))


def _lost(step: Step) -> str:
    """Why a job may differ from what the file describes: Rigel runs a job by its name, without overrides."""
    overrides = step.overrides.mapping() if step.overrides is not None else {}
    lost = [key for key in overrides if key not in _SCHEDULER]
    if not lost:
        return ""
    return (
        f"{step.node.place}: {', '.join(lost)} of job {step.job} is not passed on: `rigel run job` takes no overrides"
    )


def refuse_thesis(rigelfile: Rigelfile, wanted: Sequence[Action]) -> None:
    """Rigel itself refuses a file with `orchestration` at the top, so it cannot build from it."""
    first = next((action for action in wanted if action.kind is Kind.RIGEL), None)
    if first is not None and rigelfile.generation is Generation.THESIS:
        raise BridgeError(
            rigelfile.node.place,
            f"Rigel refuses a file with orchestration at the top, so job {first.job} cannot run: build the image yourself and "
            "add --no-build, or move the block to jobs.deploy.with.orchestration",
        )


def folder_name(rigelfile: Rigelfile, sequence: str) -> str:
    """The folder of a run's results below that of all runs: the name of the sequence, which leads nowhere else."""
    if "/" in sequence or sequence in ("", ".", "..") or control_character(sequence):
        raise rigelfile.node.fail(
            f"sequence {sequence[:80]!r} is no name for a folder of results: give it one without slashes"
        )
    return sequence


def run_name(app: str, sequence: str) -> str:
    """`teleop-benchmark-default`: an app of its own, so that a run never touches the one that is in use."""
    name = f"{app}-{label(sequence)}"
    if len(name) <= MAX_APP_NAME:
        return name
    return f"{name[: MAX_APP_NAME - 7].rstrip('-')}-{sha256(name.encode()).hexdigest()[:6]}"


def described(sequences: Mapping[str, Sequence[Step]]) -> list[str]:
    """One line per sequence: its jobs in order."""
    return [f"{name}: {' -> '.join(step.job for step in steps)}" for name, steps in sequences.items()]
