"""ROS parameters of a component: files that are passed to its process in the order in which they are written."""

from typing import Annotated

from pydantic import Field, StringConstraints

from robotapp_api.model.base import Model
from robotapp_api.model.markers import Rule
from robotapp_api.model.patterns import ROBOT_REFERENCE
from robotapp_api.model.scalars import NameOfRobot

INLINE_BYTES = 65_536
ParameterKey = Annotated[
    str,
    StringConstraints(min_length=1, max_length=253, pattern=f"^([-._a-zA-Z0-9]|{ROBOT_REFERENCE})+$"),
]


class ConfigMapKey(Model):
    """One key of a ConfigMap of this namespace."""

    name: NameOfRobot
    """Name of the ConfigMap; $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) as in key."""
    key: ParameterKey
    """Key whose value is the file. $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) stand for the names of robot and instance."""
    optional: bool = False
    """true leaves the file out while the ConfigMap or the key does not exist; false keeps the pod from starting."""


class SecretKey(Model):
    """One key of a Secret of this namespace. The operator never reads it; a change starts the pod anew only where it may watch metadata of Secrets."""

    name: NameOfRobot
    """Name of the Secret; $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) as in key."""
    key: ParameterKey
    """Key whose value is the file. $(ROBOTAPP_ROBOT) and $(ROBOTAPP_INSTANCE) stand for the names of robot and instance."""


class Parameters(Model):
    """One ROS parameter file: exactly one of inline, configMapKeyRef and secretKeyRef."""

    RULES = (
        Rule(
            rule="[has(self.inline), has(self.configMapKeyRef), has(self.secretKeyRef)].exists_one(x, x)",
            message="an entry of parameters is one file; write exactly one of inline, configMapKeyRef, secretKeyRef",
        ),
    )

    inline: Annotated[str, StringConstraints(min_length=1, max_length=INLINE_BYTES)] | None = None
    """The file itself: YAML as ROS reads it, at most 64 KiB. Text, so that 1.0 stays a double."""
    config_map_key_ref: ConfigMapKey | None = None
    """A file kept in a ConfigMap; a change of its content rolls the pod."""
    secret_key_ref: SecretKey | None = None
    """A file kept in a Secret."""


ParameterFiles = Annotated[tuple[Parameters, ...], Field(max_length=16)]
