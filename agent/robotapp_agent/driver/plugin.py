"""Prepares and unprepares claims: decides by the rules, records in the checkpoint, then writes the CDI spec."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple

import msgspec

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.messages import ClaimReference, DeviceAnswer
from robotapp_agent.driver.node_files import CdiFolder, Checkpoint, DeviceFiles
from robotapp_agent.driver.rules.allocation import ResourceClaim, plan_preparation
from robotapp_agent.driver.rules.cdi_spec import DeviceFile, cdi_id, files_of, spec_of
from robotapp_agent.driver.rules.ledger import Held, Ledger, PreparedClaim
from robotapp_agent.driver.rules.refusal import Refusal
from robotapp_claims.rules.identity import claim_name_device
from robotapp_client.api.client import ApiClient
from robotapp_client.api.resources import RESOURCECLAIMS, ROBOTCLAIMS
from robotapp_client.transport.errors import ClientError, NotFound, means_gone

log = logging.getLogger(__name__)


class NodeFolders(NamedTuple):
    """Files and folders of the node that the plugin reads and writes."""

    checkpoint: Checkpoint
    cdi: CdiFolder
    device_files: DeviceFiles


MOST_REFUSED: Final = 1024
"""Claims that are remembered as refused; more are forgotten, and only wait less the next time."""


class Patience(NamedTuple):
    """Seconds that a preparation waits for a device in use. The kubelet would try again after 12 s only, and gives a call 45 s."""

    first_s: float = 3.0
    """A claim's first try while another claim has the device in the API, too: the event that names the holder comes soon."""
    later_s: float = 30.0
    """A claim's next try, and the first one after a holder whose claim is gone: 30 s are the usual grace period of its pod."""
    look_again_s: float = 1.0
    """A claim that no pod uses keeps its device until it is deleted or deallocated, which only a read shows."""
    call_s: float = 40.0
    """A whole preparation with all it reads: beyond the kubelet's patience its event would name no reason."""


PATIENCE: Final = Patience()


class Preparation(msgspec.Struct, eq=False):
    """A call that is on its way. `is_void`: the kubelet gave the claim back meanwhile, and would not do so again."""

    uid: str
    is_void: bool = False


class DevicePlugin:
    """The lock of one node's devices. Call everything from one event loop.

    Between the look at the ledger and the checkpoint nothing is awaited, so two claims never pass the lock together. What was read
    about the claim that had a device last counts for the very entry that stood in the ledger when the read began: if that was
    prepared and given back meanwhile, it is read again.
    """

    def __init__(
        self,
        client: ApiClient,
        folders: NodeFolders,
        *,
        node: str,
        boot_id: str,
        runtime_problem: Callable[[], str] = str,
        patience: Patience = PATIENCE,
    ) -> None:
        """runtime_problem: a reason why containers would not get what is prepared, "" for none. Raises CheckpointError."""
        self._client = client
        self._folders = folders
        self._node = node
        self._boot_id = boot_id
        self._runtime_problem = runtime_problem
        self._patience = patience
        self._refused: set[str] = set()
        """Claims that were told who has their device."""
        self._preparations: set[Preparation] = set()
        self._releases = asyncio.Condition()
        self._devices: dict[str, Device] = {}
        self._ledger = folders.checkpoint.load()

    def __repr__(self) -> str:
        return f"<DevicePlugin of {self._node}: {len(self._ledger.claims)} claims, {len(self._devices)} devices>"

    def update_devices(self, devices: Iterable[Device]) -> None:
        """Takes in a scan: a device that was plugged in again may have another path, which the next container gets.

        Unless that path is what a container of another claim has from a device that it lost: it could open both.
        """
        self._devices = {device.id: device for device in devices}
        claims = {uid: self._number(claim) for uid, claim in self._ledger.claims.items()}
        try:
            self._save(Ledger(claims=claims))
        except OSError as error:
            log.warning("numbers of devices are not recorded: %s", error)
        for claim in claims.values():
            if not claim.boot_id:
                continue
            try:
                held = self._ledger.find_holder(claim)
                if held is None:
                    self._write_spec(claim)
                elif claim.uid in self._folders.cdi.list_uids():
                    self._folders.cdi.remove(claim.uid)
                    log.warning("claim %s/%s: %s", claim.namespace, claim.name, self._explain(held, claim))
            except OSError as error:
                log.warning("the CDI spec of claim %s/%s is not written: %s", claim.namespace, claim.name, error)

    def remove_leftovers(self) -> None:
        """Removes CDI specs of claims that are not prepared: what the driver was ended in the middle of."""
        for uid in self._folders.cdi.list_uids():
            claim = self._ledger.claims.get(uid)
            if claim is None or not claim.boot_id:
                self._folders.cdi.remove(uid)

    async def forget_gone_claims(self) -> None:
        """Forgets claims that no container uses and that are gone. Others keep their devices."""
        for claim in list(self._ledger.claims.values()):
            if not claim.is_prepared(self._boot_id):
                await self._forget_if_gone(claim)

    async def prepare(self, reference: ClaimReference) -> tuple[DeviceAnswer, ...] | str:
        """The devices for the kubelet, or why the claim cannot be prepared. Preparing again changes nothing."""
        preparation = Preparation(reference.uid)
        self._preparations.add(preparation)
        try:
            async with asyncio.timeout(self._patience.call_s):
                plan = await self._plan(reference)
                if isinstance(plan, PreparedClaim) and await self._wait_until_free(plan):
                    plan = await self._plan(
                        reference
                    )  # meanwhile the claim may have been deleted, or given another device
        except TimeoutError:
            return f"{_name(reference)} is not prepared after {self._patience.call_s:.0f} s: the API server answers too slowly"
        finally:
            self._preparations.discard(preparation)
        if preparation.is_void:
            return f"{_name(reference)} was given back by the kubelet while it was prepared"
        return self._record(plan) if isinstance(plan, PreparedClaim) else plan

    async def _plan(self, reference: ClaimReference) -> PreparedClaim | str:
        """The claim as it would be recorded, or why it cannot be prepared."""
        if problem := self._runtime_problem():
            return f"node {self._node} hands out no devices: {problem}"
        try:
            claim = await self._client.get(
                RESOURCECLAIMS, reference.name, namespace=reference.namespace, as_type=ResourceClaim
            )
        except (ClientError, msgspec.ValidationError) as error:
            recorded_claim = self._ledger.claims.get(reference.uid)
            if recorded_claim is None or isinstance(error, NotFound):
                return f"{_name(reference)} cannot be read: {error}"
            return msgspec.structs.replace(recorded_claim, boot_id=self._boot_id)
        plan = plan_preparation(claim, uid=reference.uid, node=self._node, devices=self._devices, boot_id=self._boot_id)
        if isinstance(plan, Refusal):
            return plan.text
        plan = self._number(plan)
        if reason := await self._find_robotclaim(plan):
            return reason
        while (held := self._ledger.find_holder(plan)) and await self._forget_if_gone(held.holder):
            pass
        return plan

    async def _find_robotclaim(self, plan: PreparedClaim) -> str:
        """Returns why a device that the claim had never before is not handed over: a RobotClaim holds it, or that cannot be read.

        Our scheduler allocates no such device. Another one sees the ResourceSlices alone, and those keep a device that a RobotClaim got
        after it was published.
        """
        recorded_claim = self._ledger.claims.get(plan.uid)
        known_ids = recorded_claim.device_ids if recorded_claim is not None else frozenset[str]()
        for device_id in sorted(plan.device_ids - known_ids):
            name = claim_name_device(self._node, device_id)
            try:
                await self._client.get(ROBOTCLAIMS, name, as_type=dict)
            except NotFound:
                continue
            except ClientError as error:
                return f"whether a RobotClaim holds device {device_id} of node {self._node} cannot be read: {error}"
            return f"device {device_id} of node {self._node} is in use by RobotClaim {name}; the pod starts when it is free"
        return ""

    async def _wait_until_free(self, plan: PreparedClaim) -> bool:
        """Returns when the claim's devices are free or the patience ends: whether it had to wait."""
        held = self._ledger.find_holder(plan)
        if held is None:
            return False
        patience_s = await self._choose_patience_s(plan, held)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while held := self._ledger.find_holder(plan):
                    if held.holder.is_prepared(self._boot_id):
                        await self._wait_for_release(held.holder)
                    elif not await self._forget_if_gone(held.holder):
                        await asyncio.sleep(self._patience.look_again_s)
        return True

    async def _choose_patience_s(self, plan: PreparedClaim, held: Held) -> float:
        """Returns how long the claim waits for its holder: longer for one whose claim is gone, because its pod is about to end."""
        if plan.uid in self._refused:
            return self._patience.later_s
        allocated = await self._read_allocated(held.holder)
        is_given_up = allocated is not None and (held.former or held.device) not in allocated
        return self._patience.later_s if is_given_up else self._patience.first_s

    async def _wait_for_release(self, holder: PreparedClaim) -> None:
        async with self._releases:
            await self._releases.wait_for(lambda: self._ledger.claims.get(holder.uid) is not holder)

    async def unprepare(self, reference: ClaimReference) -> str:
        """Gives the claim's devices back; the error, or "" when they are free."""
        self._refused.discard(reference.uid)
        for preparation in self._preparations:
            preparation.is_void = preparation.is_void or preparation.uid == reference.uid
        try:
            # First the device, then the lock.
            self._folders.cdi.remove(reference.uid)
            self._save(self._ledger.release(reference.uid))
        except OSError as error:
            return f"the devices of {_name(reference)} are not given back: {error}"
        log.info("%s is given back by the kubelet", _name(reference))
        async with self._releases:
            self._releases.notify_all()
        return ""

    def _record(self, claim: PreparedClaim) -> tuple[DeviceAnswer, ...] | str:
        claim = self._number(claim)
        ledger = self._ledger.prepare(claim)
        if isinstance(ledger, Held):
            if len(self._refused) >= MOST_REFUSED:
                self._refused.clear()
            self._refused.add(claim.uid)
            return self._explain(ledger, claim)
        if former_device := self._ledger.find_former_device(claim):
            return (
                f"claim {claim.namespace}/{claim.name} was given another device while a container may still have {former_device} of node "
                f"{self._node}: it gets the other one when all pods that use the claim have ended"
            )
        try:
            # First the lock, then the device: a driver that ends in between refuses others when it is back.
            self._save(ledger)
            if not self._write_spec(claim):
                return (
                    f"a device of claim {claim.namespace}/{claim.name} on node {self._node} has no device file any more"
                )
        except OSError as error:
            return f"claim {claim.namespace}/{claim.name} is not prepared on node {self._node}: {error}"
        self._refused.discard(claim.uid)
        log.info("claim %s/%s is prepared: %s", claim.namespace, claim.name, ", ".join(d.device for d in claim.devices))
        return tuple(DeviceAnswer(d.request, d.pool, d.device, cdi_id(claim, d)) for d in claim.devices)

    def _explain(self, held: Held, claim: PreparedClaim) -> str:
        return held.explain(node=self._node, namespace=claim.namespace)

    def _write_spec(self, claim: PreparedClaim) -> bool:
        """Writes the CDI spec; returns whether the claim's devices are all there.

        Without one of them the spec goes: its device file may become that of another device, which a container that restarts would open.
        """
        spec = spec_of(claim, self._devices, {d.device: self._files(d.device) for d in claim.devices})
        if spec is None:
            self._folders.cdi.remove(claim.uid)
            return False
        self._folders.cdi.write(claim.uid, spec)
        return True

    def _number(self, claim: PreparedClaim) -> PreparedClaim:
        """Returns the claim with the numbers that its device files have now, or had when they were seen last."""
        recorded_claim = self._ledger.claims.get(claim.uid, claim)
        former_numbers = {device.device: device.numbers for device in recorded_claim.devices}
        devices = []
        for device in claim.devices:
            current = self._devices.get(device.device)
            files = self._files(device.device) if current is not None and current.present else []
            numbers = tuple(file.number for file in files if file.number)
            devices.append(
                msgspec.structs.replace(device, numbers=numbers or former_numbers.get(device.device, device.numbers))
            )
        return claim if tuple(devices) == claim.devices else msgspec.structs.replace(claim, devices=tuple(devices))

    def _files(self, device_id: str) -> list[DeviceFile]:
        device = self._devices.get(device_id)
        if device is None:
            return []
        files = self._folders.device_files
        paths = files_of(device, files.list_sound())
        first, *further = [files.find(path) for path in paths] or [None]
        return [] if first is None else [first, *(file for file in further if file is not None)]

    def _save(self, ledger: Ledger) -> None:
        """Makes this ledger the one that counts. Raises OSError, and then the one before it still does."""
        if ledger != self._ledger:
            self._folders.checkpoint.save(ledger)
            self._ledger = ledger

    async def _forget_if_gone(self, claim: PreparedClaim) -> bool:
        """Forgets devices of an entry of the ledger that its claim has no more, if no container has them; returns whether it did."""
        if claim.is_prepared(self._boot_id):
            return False
        allocated = await self._read_allocated(claim)
        if allocated is None:
            return False
        # An equal entry is not enough: the claim may have been allocated, prepared and given back since it was read.
        if self._ledger.claims.get(claim.uid) is not claim:
            return False
        ledger = self._ledger.forget_unallocated(claim.uid, allocated=allocated, boot_id=self._boot_id)
        if ledger is self._ledger:
            return False
        try:
            self._folders.cdi.remove(claim.uid)
            self._save(ledger)
        except OSError as error:
            log.warning("claim %s/%s still keeps its devices: %s", claim.namespace, claim.name, error)
            return False
        log.info("claim %s/%s has given its devices back", claim.namespace, claim.name)
        return True

    async def _read_allocated(self, claim: PreparedClaim) -> set[str] | None:
        """Returns which devices of this node the API server shows as the claim's, none for a claim that is gone; None if it cannot be read."""
        try:
            current = await self._client.get(
                RESOURCECLAIMS, claim.name, namespace=claim.namespace, as_type=ResourceClaim
            )
        except (ClientError, msgspec.ValidationError) as error:
            is_gone = isinstance(error, NotFound) and means_gone(error, claim.name)
            return set() if is_gone else None
        if current.metadata.uid != claim.uid:
            return set()
        return {result.device for result in current.results if result.pool == self._node}


def _name(reference: ClaimReference) -> str:
    return f"claim {reference.namespace}/{reference.name}"
