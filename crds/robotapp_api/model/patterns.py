"""Patterns of the API's strings. RE2 and pydantic's engine share the syntax used here.

They stand apart from the types, so that programs which only read such strings do not load pydantic (9 MB).
"""

import re
from typing import Final

LABEL_PATTERN: Final = r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?$"
LABEL_VALUE_PATTERN: Final = r"^(([A-Za-z0-9][-A-Za-z0-9_.]*)?[A-Za-z0-9])?$"
SUBDOMAIN_PATTERN: Final = r"^[a-z0-9]([-a-z0-9]*[a-z0-9])?(\.[a-z0-9]([-a-z0-9]*[a-z0-9])?)*$"
CRON_NAME_PATTERN: Final = "^@(yearly|annually|monthly|weekly|daily|midnight|hourly)$"
"""Names that CronJobs have for some lines."""
CRON_FIELDS_PATTERN: Final = "^[0-9A-Za-z*,/-]+( +[0-9A-Za-z*,/-]+){4}$"
CRON_PATTERN: Final = f"{CRON_NAME_PATTERN}|{CRON_FIELDS_PATTERN}"
TIME_ZONE_PATTERN: Final = "^[A-Za-z][A-Za-z0-9_+-]*(/[A-Za-z0-9_+-]+){0,2}$"
DURATION_PATTERN: Final = r"^([0-9]{1,6}([.][0-9]{1,3})?(us|ms|s|m|h)){1,3}$"
QUANTITY_PATTERN: Final = (
    r"^(([0-9]{1,15}(\.[0-9]{0,9})?)|(\.[0-9]{1,9}))(([KMGTPE]i)|[numkMGTPE]|([eE][+-]?[0-9]{1,2}))?$"
)
IMAGE_PATTERN: Final = r"^\S*$"
"""No image name has blanks; without this rule the kubelet would say so after the pod was placed."""

ROBOT_REFERENCE: Final = r"\$\((ROBOTAPP_ROBOT|ROBOTAPP_INSTANCE|ROBOTAPP_ORDINAL)\)"
"""The names of robot and instance, which the operator writes in the reference's place."""
_NAME_END: Final = f"([a-z0-9]|{ROBOT_REFERENCE})"
_NAME_PART: Final = f"{_NAME_END}(([-a-z0-9]|{ROBOT_REFERENCE})*{_NAME_END})?"
NAME_OF_ROBOT: Final = rf"^{_NAME_PART}(\.{_NAME_PART})*$"
"""Name of an object that may differ from robot to robot."""
_VALUE_END: Final = f"([A-Za-z0-9]|{ROBOT_REFERENCE})"
LABEL_VALUE_OF_ROBOT: Final = f"^(({_VALUE_END}([-A-Za-z0-9_.]|{ROBOT_REFERENCE})*)?{_VALUE_END})?$"
"""Value of a label that may differ from robot to robot."""

DEVICE_PATH_PATTERN: Final = r"^/dev(/[A-Za-z0-9][A-Za-z0-9._:@+-]*)+$"
"""Where a device appears in containers: below /dev, without `.` and `..`."""
PATHS_OF_CONTAINERS: Final = "^/dev/(null|zero|full|random|urandom|tty|ptmx|console|stdin|stdout|stderr|core|termination-log|fd|pts|shm|mqueue)(/|$)"
"""Devices, links and folders that the container runtime makes in every container: a device is neither there nor below."""


def is_device_path(text: str) -> bool:
    """Returns whether a device may appear at the path."""
    is_path = len(text) <= 96 and re.fullmatch(DEVICE_PATH_PATTERN, text) is not None and not text.endswith("\n")
    return is_path and re.search(PATHS_OF_CONTAINERS, text) is None
