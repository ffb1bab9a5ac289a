"""Finds schedules that are never due, less often than they seem, or in time zones that do not exist."""

from collections.abc import Iterator

from robotapp_api.checks.problem import Note, Problem, invalid
from robotapp_api.model.app.robotapp import RobotAppSpec
from robotapp_api.model.names import QUEUE_NAME
from robotapp_api.values.schedules.due_times import describe_long_step, parse_due_times, parse_time_zone


def schedule_problems(spec: RobotAppSpec) -> Iterator[Problem]:
    """Yields what is wrong with the line or the zone of each schedule, with its place in the spec."""
    for index, component in enumerate(spec.components):
        schedule = component.schedule
        if schedule is None:
            continue
        at = f"spec.components[{index}].schedule"
        try:
            parse_time_zone(schedule.time_zone)
        except ValueError as error:
            yield invalid(f"{at}.timeZone", str(error))
            continue
        try:
            parse_due_times(schedule.cron, schedule.time_zone)
        except ValueError as error:
            yield invalid(f"{at}.cron", str(error))


def schedule_notes(spec: RobotAppSpec) -> Iterator[Note]:
    """Yields each line that is due less often than it seems."""
    for index, component in enumerate(spec.components):
        if component.schedule is not None and (text := describe_long_step(component.schedule.cron)):
            yield Note(f"spec.components[{index}].schedule.cron", text)


def queue_problems(spec: RobotAppSpec, queue: str) -> Iterator[Problem]:
    """Yields that a component with schedule does not wait in a queue: between its runs a Job of it would be resumed there."""
    if queue and any(component.schedule for component in spec.components):
        yield invalid(
            f'metadata.labels["{QUEUE_NAME}"]',
            "jobs with schedule do not wait in a queue of kueue; remove the label, or put the components with schedule into an app of their own",
        )
