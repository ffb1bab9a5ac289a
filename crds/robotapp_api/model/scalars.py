"""Strings and numbers with the bounds and patterns of the API."""

from typing import Annotated, Any, Final

from pydantic import Field, StringConstraints, WithJsonSchema

from robotapp_api.model.markers import Rule
from robotapp_api.model.patterns import (
    CRON_FIELDS_PATTERN,
    CRON_NAME_PATTERN,
    CRON_PATTERN,
    DURATION_PATTERN,
    IMAGE_PATTERN,
    LABEL_PATTERN,
    NAME_OF_ROBOT,
    QUANTITY_PATTERN,
    SUBDOMAIN_PATTERN,
    TIME_ZONE_PATTERN,
)


def is_duration(expression: str) -> str:
    """CEL: whether a string can be given to duration(), which fails on others. Rules that compare durations ask first."""
    return f"{expression}.matches('{DURATION_PATTERN}')"


DnsLabel = Annotated[str, StringConstraints(min_length=1, max_length=63, pattern=LABEL_PATTERN)]
DnsName = Annotated[str, StringConstraints(min_length=1, max_length=253, pattern=SUBDOMAIN_PATTERN)]
NameOfRobot = Annotated[str, StringConstraints(min_length=1, max_length=253, pattern=NAME_OF_ROBOT)]
"""Name of an object that may differ from robot to robot."""
AppName = Annotated[str, StringConstraints(min_length=1, max_length=40, pattern=LABEL_PATTERN)]
"""Name of a RobotApp or DomainPool: names of children and claims are derived from it."""

NodeName = Annotated[str, StringConstraints(min_length=1, max_length=253)]
ShortText = Annotated[str, StringConstraints(max_length=63)]
Text = Annotated[str, StringConstraints(max_length=253)]
Image = Annotated[str, StringConstraints(min_length=1, max_length=512, pattern=IMAGE_PATTERN)]
OptionalImage = Annotated[str, StringConstraints(max_length=512, pattern=IMAGE_PATTERN)]
Token = Annotated[str, StringConstraints(min_length=1, max_length=32, pattern=LABEL_PATTERN)]
"""Type of a device or capability, such as usb or gpu."""

Duration = Annotated[
    str,
    StringConstraints(max_length=24, pattern=DURATION_PATTERN),
    WithJsonSchema({"type": "string", "maxLength": 24}),
    Rule(
        rule=is_duration("self"),
        message="write a number and a unit (us, ms, s, m or h), up to three times, for example 30ms, 1.5s or 1m30s",
    ),
]
"""A rule instead of a pattern: the API server shows a pattern as it is, and a rule's message instead of the rule."""

_CRON_ZONE: Final = "^(CRON_)?TZ="
_FIVE_FIELDS: Final = "^ *[^ ]+( +[^ ]+){4} *$"
"""Five words of any characters: a line that has them is refused for another reason than their number."""

CronLine = Annotated[
    str,
    StringConstraints(max_length=100, pattern=CRON_PATTERN),
    WithJsonSchema({"type": "string", "maxLength": 100}),
    Rule(
        rule="!self.startsWith('@every')",
        message="a schedule has times of day and no intervals; write for example */5 * * * * for every five minutes, or @hourly",
    ),
    Rule(
        rule=f"!self.startsWith('@') || self.startsWith('@every') || self.matches('{CRON_NAME_PATTERN}')",
        message="the names are @hourly, @daily or @midnight, @weekly, @monthly, @yearly or @annually, in small letters; write one of them, "
        "or five fields, for example 0 2 * * *",
    ),
    Rule(
        rule=f"!self.matches('{_CRON_ZONE}')",
        message="a cron line has no time zone; write it into timeZone, and the five fields alone here",
    ),
    Rule(
        rule=f"self.startsWith('@') || self.matches('{_CRON_ZONE}') || self.matches('{_FIVE_FIELDS}')",
        message="write five fields: minute, hour, day of the month, month and day of the week, for example 0 2 * * *",
        expression="'%d fields are written; write five: minute, hour, day of the month, month and day of the week, for example 0 2 * * *'"
        ".format([self.split(' ').filter(f, f != '').size()])",
    ),
    Rule(
        rule=f"self.startsWith('@') || self.matches('{_CRON_ZONE}') || !self.matches('{_FIVE_FIELDS}') || self.matches('{CRON_FIELDS_PATTERN}')",
        message="fields have digits, letters and * , - / alone, with blanks between them; write * for every one, for example 0 2 * * *",
    ),
]
TimeZone = Annotated[
    str,
    StringConstraints(max_length=64, pattern=TIME_ZONE_PATTERN),
    WithJsonSchema({"type": "string", "maxLength": 64}),
    Rule(
        rule=f"self.matches('{TIME_ZONE_PATTERN}')",
        message="write a name of the IANA database of time zones, for example Europe/Athens or UTC",
    ),
]

Timestamp = Annotated[
    str, StringConstraints(max_length=64), WithJsonSchema({"type": "string", "format": "date-time", "maxLength": 64})
]

TopicName = Annotated[
    str,
    StringConstraints(
        min_length=1, max_length=255, pattern=r"^(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$"
    ),
]
InterfaceType = Annotated[
    str, StringConstraints(max_length=255, pattern=r"^[a-zA-Z][a-zA-Z0-9_]*/((msg|srv|action)/)?[A-Z][A-Za-z0-9_]*$")
]
EdgeEnd = Annotated[str, StringConstraints(max_length=63, pattern=r"^(@robot|[a-z0-9]([-a-z0-9]*[a-z0-9])?)$")]

DomainId = Annotated[int, Field(ge=0, le=232)]
Count = Annotated[int, Field(ge=0)]
Generation = Annotated[int, Field(ge=0), WithJsonSchema({"type": "integer", "format": "int64", "minimum": 0})]
Percent = Annotated[int, Field(ge=0, le=100)]
Microseconds = Annotated[int, WithJsonSchema({"type": "integer", "format": "int64", "minimum": 0})]

QUANTITY_SCHEMA: dict[str, Any] = {
    "x-kubernetes-int-or-string": True,
    "anyOf": [{"type": "integer"}, {"type": "string"}],
    "maxLength": 32,
    "pattern": QUANTITY_PATTERN,
}
Quantity = Annotated[
    int | Annotated[str, StringConstraints(max_length=32, pattern=QUANTITY_PATTERN)], WithJsonSchema(QUANTITY_SCHEMA)
]
"""A Kubernetes quantity, such as 40M. Kept as written; `robotapp_api.values.quantities.quantity` reads it."""
