"""Numbers the attempts of an instance (completion.maxRestarts) by its Jobs, and by a record in its RobotAppInstance.

A Job that has failed is deleted before its successor of the same name can be made, so for a moment there may be no Job.
Therefore the next attempt is written into the status of the RobotAppInstance first; then the Jobs of earlier attempts
are replaced. The Jobs alone decide whether the instance ends or is started again
(`robotapp_claims.rules.completion.endings`). The record only numbers new ones: if it is lost, no domain is given back
too early, and the count begins anew only where no Job is left either.
"""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from robotapp_api.model.names import Annotation
from robotapp_claims.rules.completion.endings import Ending, Failure, JobState, count_restarts, find_beginning

RESTARTS_FIELD: Final = "restarts"
"""Field of the status of a RobotAppInstance with the record."""
COMPLETION_TIME_FIELD: Final = "completionTime"
"""Field of that status which is there while the instance has ended."""


class Attempt(NamedTuple):
    """A start of all jobs of an instance."""

    number: int = 0
    """0 for the first attempt. It never becomes smaller: jobs with a smaller number are replaced."""
    restarts: int = 0
    """How many of completion.maxRestarts are used."""
    run_hash: str = ""
    """Hash of what the jobs run; with another one the count of restarts begins anew."""
    began: str = ""
    """Since when completion.deadline counts; "" for the first attempt."""
    message: str = ""
    """Why the instance was started again last."""

    @property
    def annotations(self) -> dict[str, str]:
        """Returns the annotations of its Jobs; none for the first attempt."""
        if not self.number:
            return {}
        texts = {
            Annotation.ATTEMPT: str(self.number),
            Annotation.RESTARTS: str(self.restarts),
            Annotation.BEGAN: self.began,
        }
        return {key.value: text for key, text in texts.items() if text}


FIRST_ATTEMPT: Final = Attempt()


def read_attempt(status: Mapping[str, Any]) -> Attempt | None:
    """Returns the record in the status of a RobotAppInstance, None without one."""
    record = status.get(RESTARTS_FIELD)
    if not isinstance(record, Mapping) or not record.get("attempt"):
        return None
    return Attempt(
        number=int(record["attempt"]),
        restarts=int(record.get("count", 0)),
        run_hash=str(record.get("runHash", "")),
        began=str(record.get("began", "")),
        message=str(record.get("message", "")),
    )


def keep_number(status: Mapping[str, Any]) -> Attempt:
    """Returns the attempt of an instance that has no job any more: its other pods carry the number on."""
    record = read_attempt(status)
    return FIRST_ATTEMPT if record is None else Attempt(record.number)


def render_attempt(attempt: Attempt) -> dict[str, Any] | None:
    """Returns the record as plain JSON, None for an instance that was never started again."""
    if not attempt.number:
        return None
    texts = {"runHash": attempt.run_hash, "began": attempt.began, "message": attempt.message}
    return {"count": attempt.restarts, "attempt": attempt.number} | {key: text for key, text in texts.items() if text}


def describe_pending(attempt: Attempt) -> Attempt:
    """Returns an attempt that is not recorded yet, with the message for what is still to be done."""
    return attempt._replace(message=attempt.message.replace("restarted", "to be restarted", 1))


def describe_missing_object(attempt: Attempt, name: str) -> str:
    """Returns why an instance is not started again that has no RobotAppInstance of this name, and what to do."""
    return (
        f"{describe_pending(attempt).message}; this has to be recorded in RobotAppInstance {name}, which does not exist: raise the "
        "ResourceQuota that refuses it (the operator's log has the refusal), or write completion.maxRestarts: 0"
    )


def find_attempt(
    jobs: Mapping[str, JobState], status: Mapping[str, Any], *, run_hash: str, ending: Ending | None
) -> Attempt:
    """Returns the present attempt. jobs: by component, without edited ones. status: that of the RobotAppInstance.

    The count begins anew when a job was edited, and when an instance that had ended has not ended any more: then
    somebody has deleted a Job to have it run again, or has written other limits.
    """
    record, by_jobs = read_attempt(status), _find_attempt_of_jobs(jobs, run_hash=run_hash)
    if record is None or record.number < by_jobs.number or (ending is not None and record.number > by_jobs.number):
        return by_jobs
    is_new = record.run_hash != run_hash or COMPLETION_TIME_FIELD in status
    if ending is None and is_new:
        return Attempt(record.number, run_hash=run_hash)
    return record


def _find_attempt_of_jobs(jobs: Mapping[str, JobState], *, run_hash: str) -> Attempt:
    number = max((job.attempt for job in jobs.values()), default=0)
    began = min((job.began for job in jobs.values() if job.attempt == number), default="")
    return Attempt(number, count_restarts(jobs), run_hash, began)


def plan_next_attempt(
    jobs: Mapping[str, JobState], present: Attempt, failure: Failure, *, max_restarts: int
) -> Attempt:
    """Returns the attempt that follows because a job has failed. jobs: those of the present one."""
    restarts = count_restarts(jobs) + 1
    reason = f" ({failure.reason})" if failure.reason else ""
    message = f"restarted {restarts} of {max_restarts} times: job {failure.component} failed{reason}"
    return Attempt(present.number + 1, restarts, present.run_hash, find_beginning(jobs), message)
