"""Checks whether ROS_DOMAIN_ID of a pod with the annotation dds-domain will hold the domain that the scheduler grants.

The kubelet fills a variable from an annotation that is absent with empty text, and ROS then joins domain 0 without a
word. The environment of a pod never changes, so such a pod is refused before it starts.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

from robotapp_api.model.names import Annotation
from robotapp_scheduler.core.api.core_v1 import PodSpec
from robotapp_scheduler.core.api.ros import InvalidAnnotation

_ANNOTATION_PATH: Final = re.compile(r"metadata\.annotations\[(['\"])(.{1,300})\1\]")
_GRANTED_PATH: Final = f"metadata.annotations['{Annotation.GRANTED_DOMAIN}']"


def find_lost_domain(spec: PodSpec, annotations: Mapping[str, str], dds_domain: str) -> InvalidAnnotation | None:
    """Returns the first ROS_DOMAIN_ID that is filled from an annotation which does not hold the granted domain.

    `dds_domain` is "auto" or a decimal id. An annotation of the user's own may be read while it states that very id.
    """
    for container in (*(spec.init_containers or ()), *spec.containers):
        for variable in container.env or ():
            path = _read_field_path(variable.value_from)
            match = _ANNOTATION_PATH.fullmatch(path)
            if match is None or match[2] == Annotation.GRANTED_DOMAIN:
                continue
            if dds_domain != "auto" and annotations.get(match[2]) == dds_domain:
                continue
            return InvalidAnnotation(
                key=str(Annotation.DDS_DOMAIN),
                field=f"env ROS_DOMAIN_ID of container {container.name}",
                value=f'fieldPath "{path}"',
                allowed=f"{_GRANTED_PATH}, where the scheduler writes the domain",
            )
    return None


def _read_field_path(value_from: Any) -> str:
    """Returns valueFrom.fieldRef.fieldPath; empty for other sources and for what is no such object."""
    field_ref = value_from.get("fieldRef") if isinstance(value_from, dict) else None
    path = field_ref.get("fieldPath") if isinstance(field_ref, dict) else None
    return path if isinstance(path, str) else ""
