"""The lock of the node's devices: which claim each was prepared for last. The API lets two claims have one device; here it ends."""

from collections.abc import Collection
from typing import Final, NamedTuple

import msgspec

VERSION: Final = 1


class PreparedDevice(msgspec.Struct, frozen=True):
    """One device of a prepared claim, with everything that its CDI spec is written from."""

    request: str
    pool: str
    device: str
    variable: str
    mount_as: str = ""
    admin: bool = False
    """Admin access: beside whoever has the device, so it neither takes nor respects the lock."""
    numbers: tuple[int, ...] = ()
    """Numbers of its device files when it was seen last. When it is unplugged, the kernel gives them to another device, which the container
    that lost this one can open then."""


class PreparedClaim(msgspec.Struct, frozen=True):
    """A claim whose devices containers may have, or had last.

    The lock outlives the pod: between two pods of a claim its device is still the claim's, and only the API server shows
    whether the claim has given it up.
    """

    uid: str
    namespace: str
    name: str
    boot_id: str
    """Of the boot in which it was last prepared, "" once the kubelet has given it back. See `is_prepared`."""
    devices: tuple[PreparedDevice, ...] = ()

    def is_prepared(self, boot_id: str) -> bool:
        """Returns whether containers may have the devices. After another boot none has, until the claim is prepared again."""
        return self.boot_id == boot_id

    @property
    def device_ids(self) -> frozenset[str]:
        """Devices that the claim keeps from others."""
        return frozenset(device.device for device in self.devices if not device.admin)


class Held(NamedTuple):
    """Another claim stands in the way."""

    device: str
    holder: PreparedClaim
    former: str = ""
    """The holder's own device, where that is another one: unplugged, and its device file is now that of `device`."""

    def explain(self, *, node: str, namespace: str) -> str:
        """Reason for the events of a pod of `namespace`, which must not learn names of other namespaces."""
        holder = self.holder
        holder_text = f"claim {holder.name}" if holder.namespace == namespace else "a claim of another namespace"
        reason = f" for {self.former}, which was unplugged and had the same device file" if self.former else ""
        return f"device {self.device} of node {node} is in use by {holder_text}{reason}; the pod starts when it is free"


class Ledger(msgspec.Struct, frozen=True):
    """All prepared claims by uid. Every change gives another ledger, which counts once it is on the disk."""

    version: int = VERSION
    claims: dict[str, PreparedClaim] = {}

    def find_holder(self, claim: PreparedClaim) -> Held | None:
        """The first claim that has one of this claim's devices; pods that name the same claim share it."""
        device_ids = claim.device_ids
        for other in self.claims.values():
            if other.uid == claim.uid:
                continue
            for device in other.devices:
                if device.admin:
                    continue
                if device.device in device_ids:
                    return Held(device.device, other)
                twin = _find_twin(claim, device) if other.is_prepared(claim.boot_id) else ""
                if twin:
                    return Held(twin, other, device.device)
        return None

    def find_former_device(self, claim: PreparedClaim) -> str:
        """A device that this claim is prepared with and is not to have any more, "" without one: a container may still have it."""
        recorded_claim = self.claims.get(claim.uid)
        if recorded_claim is None or not recorded_claim.is_prepared(claim.boot_id):
            return ""
        return min(recorded_claim.device_ids - claim.device_ids, default="")

    def prepare(self, claim: PreparedClaim) -> "Ledger | Held":
        """The ledger with this claim, in place of what it had before; or who is in the way."""
        blocker = self.find_holder(claim)
        return blocker or Ledger(claims={**self.claims, claim.uid: claim})

    def release(self, uid: str) -> "Ledger":
        """The ledger after the kubelet has given a claim back. Its devices stay locked until `forget`."""
        claim = self.claims.get(uid)
        if claim is None:
            return self
        if not claim.device_ids:
            return self.forget(uid, allocated=())
        return Ledger(claims={**self.claims, uid: msgspec.structs.replace(claim, boot_id="")})

    def forget_unallocated(self, uid: str, *, allocated: Collection[str], boot_id: str) -> "Ledger":
        """The ledger without the devices of a claim that are not allocated to it any more; itself while containers may have them."""
        claim = self.claims[uid]
        is_kept = claim.is_prepared(boot_id) or (claim.device_ids and claim.device_ids.issubset(allocated))
        return self if is_kept else self.forget(uid, allocated=allocated)

    def forget(self, uid: str, *, allocated: Collection[str]) -> "Ledger":
        """The ledger without the devices of a claim that it is not to keep."""
        claim = self.claims[uid]
        devices = tuple(device for device in claim.devices if device.device in allocated and not device.admin)
        if devices:
            return Ledger(claims={**self.claims, uid: msgspec.structs.replace(claim, devices=devices)})
        return Ledger(claims={other: claim for other, claim in self.claims.items() if other != uid})

    @property
    def device_ids(self) -> frozenset[str]:
        """Devices that claims have, or had last."""
        return frozenset(device.device for claim in self.claims.values() for device in claim.devices)


def _find_twin(claim: PreparedClaim, device: PreparedDevice) -> str:
    """Returns the device of the claim that has a device file with a number of this one's, "" for none."""
    twins = (one.device for one in claim.devices if not one.admin and not set(one.numbers).isdisjoint(device.numbers))
    return next(twins, "")
