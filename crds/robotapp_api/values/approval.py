"""The approval of an operator's templates as conditions name it: written by the operator, read by what offers a button for it."""

import re
from typing import Final

from robotapp_api.model.names import Annotation

_VERSION: Final = re.compile(rf"{re.escape(Annotation.APPROVE_UPDATE)}=([0-9A-Za-z.+!-]{{1,64}})(?=\s|$)")


def describe_approval(version: str) -> str:
    """Returns the annotation as it is given to kubectl annotate."""
    return f"{Annotation.APPROVE_UPDATE}={version}"


def read_approval(message: str) -> str:
    """Returns the version that a condition's message says to approve, empty when it says none."""
    match = _VERSION.search(message)
    return match[1] if match else ""
