"""The two gRPC services that the kubelet calls, each on a Unix socket below its folder."""

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import grpc
import grpc.aio

from robotapp_agent.driver import messages
from robotapp_agent.driver.plugin import DevicePlugin
from robotapp_claims.rules.device_attributes import DRIVER

log = logging.getLogger(__name__)

PLUGIN_SERVICE: Final = "k8s.io.kubelet.pkg.apis.dra.v1.DRAPlugin"
REGISTRATION_SERVICE: Final = "pluginregistration.Registration"
SUPPORTED: Final = ("v1.DRAPlugin",)
CHECK_S: Final = 5.0
GRACE_S: Final = 2.0
MOST_MESSAGE_BYTES: Final = 1 << 20


class SocketGoneError(Exception):
    """A socket was removed: the kubelet reaches us no longer, and another start makes it anew."""


class KubeletServer:
    """Serves the kubelet while `run` runs. `registered` is called whenever a kubelet has taken the driver in."""

    def __init__(self, plugin: DevicePlugin, kubelet_folder: Path, *, registered: Callable[[], None]) -> None:
        self._plugin = plugin
        self._registered = registered
        self.endpoint = kubelet_folder / "plugins" / DRIVER / "dra.sock"
        self.registration = kubelet_folder / "plugins_registry" / f"{DRIVER}-reg.sock"

    def __repr__(self) -> str:
        return f"<KubeletServer at {self.endpoint}>"

    async def run(self) -> None:
        """Serves until cancelled. Raises SocketGoneError when somebody removes a socket."""
        servers = [
            # The kubelet calls the first as soon as it has seen the second.
            await self._serve(self.endpoint, self._plugin_handlers()),
            await self._serve(self.registration, self._registration_handlers()),
        ]
        try:
            while True:
                await asyncio.sleep(CHECK_S)
                for path in (self.endpoint, self.registration):
                    if not path.exists():
                        raise SocketGoneError(f"{path} was removed")
        finally:
            self.registration.unlink(missing_ok=True)
            for server in servers:
                await server.stop(GRACE_S)

    async def _serve(self, path: Path, handlers: grpc.GenericRpcHandler) -> grpc.aio.Server:
        _make_room(path)
        server = grpc.aio.server(options=[("grpc.max_receive_message_length", MOST_MESSAGE_BYTES)])
        server.add_generic_rpc_handlers((handlers,))
        server.add_insecure_port(f"unix://{path}")
        await server.start()
        return server

    def _plugin_handlers(self) -> grpc.GenericRpcHandler:
        methods = {
            "NodePrepareResources": _method(self._prepare, messages.decode_claims, messages.encode_prepared),
            "NodeUnprepareResources": _method(self._unprepare, messages.decode_claims, messages.encode_unprepared),
        }
        return grpc.method_handlers_generic_handler(PLUGIN_SERVICE, methods)

    def _registration_handlers(self) -> grpc.GenericRpcHandler:
        methods = {
            "GetInfo": _method(self._info, bytes, bytes),
            "NotifyRegistrationStatus": _method(self._notify, messages.decode_registration_status, bytes),
        }
        return grpc.method_handlers_generic_handler(REGISTRATION_SERVICE, methods)

    async def _prepare(self, claims: tuple[messages.ClaimReference, ...], _: Any) -> messages.PrepareAnswers:
        # All at once: the kubelet's patience is for the call, and each claim may have to wait for its device.
        answers = await asyncio.gather(*map(self._plugin.prepare, claims))
        for answer in answers:
            if isinstance(answer, str):
                log.warning("%s", answer)
        return {claim.uid: answer for claim, answer in zip(claims, answers, strict=True)}

    async def _unprepare(self, claims: tuple[messages.ClaimReference, ...], _: Any) -> dict[str, str]:
        return {claim.uid: await self._plugin.unprepare(claim) for claim in claims}

    async def _info(self, _request: bytes, _: Any) -> bytes:
        return messages.encode_plugin_info(
            kind="DRAPlugin", name=DRIVER, endpoint=str(self.endpoint), versions=SUPPORTED
        )

    async def _notify(self, status: messages.RegistrationStatus, _: Any) -> bytes:
        if status.registered:
            log.info("the kubelet has registered the driver")
            self._registered()
        else:
            log.error("the kubelet refuses the driver: %s", status.error)
        return b""


def _make_room(path: Path) -> None:
    """Removes the socket of a driver that was killed."""
    path.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
    path.unlink(missing_ok=True)


def _method(behaviour: Any, decode: Callable[[bytes], Any], encode: Callable[[Any], bytes]) -> grpc.RpcMethodHandler:
    return grpc.unary_unary_rpc_method_handler(behaviour, request_deserializer=decode, response_serializer=encode)
