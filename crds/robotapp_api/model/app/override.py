"""Values of components that differ from robot to robot."""

from typing import Annotated

from pydantic import Field

from robotapp_api.model.app.parameters import ParameterFiles
from robotapp_api.model.app.robots import LabelSelector
from robotapp_api.model.base import Model
from robotapp_api.model.markers import Core, ListMap, MapAtomic
from robotapp_api.model.packed import PackedList, PackedMap
from robotapp_api.model.scalars import DnsLabel, Image


class ComponentOverride(Model):
    """Values of one component; a field that is left out stays as the component has it."""

    name: DnsLabel
    """Name of the component."""
    image: Image | None = None
    """Container image in place of the component's."""
    env: Annotated[PackedList, Core("Container", "env")] = PackedList()
    """Environment variables: each takes the place of the component's variable of the same name, or is added."""
    resources: Annotated[PackedMap, Core("Container", "resources")] = PackedMap()
    """Resources in place of the component's, as a whole."""
    parameters: ParameterFiles = ()
    """Parameter files after those of the component, so that they win."""


class Override(Model):
    """Values for some of the app's robots."""

    name: DnsLabel
    """Name of the override within the app."""
    node_selector: Annotated[LabelSelector, MapAtomic()]
    """Chooses robots by the labels of their primary nodes."""
    components: Annotated[tuple[ComponentOverride, ...], ListMap("name"), Field(min_length=1, max_length=64)]
    """Components whose values differ on these robots."""
