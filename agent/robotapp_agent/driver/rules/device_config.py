"""The opaque configuration that a claim or DeviceClass gives our devices: variable, path in the container, host network."""

import re
from collections.abc import Iterable
from typing import Annotated, Final, Literal

import msgspec

from robotapp_agent.driver.rules.refusal import Refusal
from robotapp_api.model.patterns import is_device_path
from robotapp_claims.rules.device_attributes import DRIVER

API_VERSION: Final = "devices.robotics.io/v1alpha1"
KIND: Final = "DeviceConfig"
VARIABLE_PREFIX: Final = "ROBOTAPP_DEVICE_"
LONGEST_PARAMETERS: Final = 10_240
"""Bytes; the API's own bound of `opaque.parameters`."""
_VARIABLE: Final = r"^[A-Z0-9_]{1,63}\Z"
"""What follows the prefix: a device may be called 3d-camera."""


class DeviceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename="camel"):
    """One configuration as parsed_config. An absent field keeps what an earlier configuration or the default has."""

    api_version: Literal["devices.robotics.io/v1alpha1"]
    kind: Literal["DeviceConfig"]
    env: Annotated[str, msgspec.Meta(pattern=_VARIABLE)] | None = None
    """The variable ROBOTAPP_DEVICE_<env> holds the path; default: the request's name in upper case."""
    mount_as: str | None = None
    """Where a container opens the device; default: its path on the host."""
    network: Literal["Host"] | None = None
    """The pod uses the node's network, where it finds network interfaces without our help."""


class RequestConfig(msgspec.Struct, frozen=True):
    """The settings that count for the devices of one request."""

    variable: str
    mount_as: str = ""
    host_network: bool = False


class Opaque(msgspec.Struct, frozen=True):
    """`opaque` of the API: parameters for one driver, as raw JSON."""

    driver: str
    parameters: msgspec.Raw = msgspec.Raw(b"null")


class AllocatedConfig(msgspec.Struct, frozen=True):
    """An entry of `status.allocation.devices.config`: those of the class come before those of the claim."""

    requests: list[str] | None = None
    opaque: Opaque | None = None


def resolve_config(request: str, configs: Iterable[AllocatedConfig]) -> RequestConfig | Refusal:
    """Merges the configurations of a request, later ones win field by field.

    request: name as in the allocation's result; `<request>/<subrequest>` where one of several alternatives was chosen.
    """
    request_config = RequestConfig(variable=VARIABLE_PREFIX + _variable_part(request))
    for config in configs:
        if config.opaque is None or config.opaque.driver != DRIVER or not _concerns(config, request):
            continue
        parsed_config = _parse(bytes(config.opaque.parameters), request)
        if isinstance(parsed_config, Refusal):
            return parsed_config
        request_config = RequestConfig(
            variable=request_config.variable if parsed_config.env is None else VARIABLE_PREFIX + parsed_config.env,
            mount_as=parsed_config.mount_as or request_config.mount_as,
            host_network=request_config.host_network or parsed_config.network is not None,
        )
    return request_config


def _concerns(config: AllocatedConfig, request: str) -> bool:
    return not config.requests or request in config.requests or request.partition("/")[0] in config.requests


def _variable_part(request: str) -> str:
    return re.sub(r"[^A-Z0-9]", "_", request.partition("/")[0].upper())


def _parse(parameters: bytes, request: str) -> DeviceConfig | Refusal:
    place = f"the {DRIVER} parameters of request {request}"
    if len(parameters) > LONGEST_PARAMETERS:
        return Refusal(f"{place} are longer than {LONGEST_PARAMETERS} bytes")
    try:
        config = msgspec.json.decode(parameters, type=DeviceConfig)
    except msgspec.DecodeError as error:
        return Refusal(
            f"{place} cannot be used: {error}. Write apiVersion: {API_VERSION}, kind: {KIND} and of env (such as LIDAR), mountAs "
            "(such as /dev/lidar) and network: Host what is needed"
        )
    if config.mount_as and not is_device_path(config.mount_as):
        return Refusal(
            f"{place}: mountAs {config.mount_as[:96]} is no path for a device; write one below /dev, such as /dev/lidar, of letters, digits "
            "and . _ : @ + -, that not every container has"
        )
    return config
