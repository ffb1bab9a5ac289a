"""The lock of the node's devices: which claim each is prepared for. The API lets two claims have one device; here it ends."""

from collections.abc import Collection, Iterable
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


class PreparedClaim(msgspec.Struct, frozen=True):
    """A claim whose devices containers may have."""

    uid: str
    namespace: str
    name: str
    boot_id: str
    """Of the boot in which it was last prepared: after another one no container of it runs until it is prepared again."""
    devices: tuple[PreparedDevice, ...] = ()


class Held(NamedTuple):
    """Another claim stands in the way."""

    device: str
    holder: PreparedClaim

    def explain(self, *, node: str, namespace: str) -> str:
        """Reason for the events of a pod of `namespace`, which must not learn names of other namespaces."""
        holder = self.holder
        holder_text = f"claim {holder.name}" if holder.namespace == namespace else "a claim of another namespace"
        return f"device {self.device} of node {node} is in use by {holder_text}; the pod starts when it is free"


class Ledger(msgspec.Struct, frozen=True):
    """All prepared claims by uid. Every change gives another ledger, which counts once it is on the disk."""

    version: int = VERSION
    claims: dict[str, PreparedClaim] = {}

    def find_holder(self, claim: PreparedClaim) -> Held | None:
        """The first claim that has one of this claim's devices; pods that name the same claim share it."""
        device_ids = {device.device for device in claim.devices if not device.admin}
        for other in self.claims.values():
            if other.uid != claim.uid:
                for device in other.devices:
                    if device.device in device_ids and not device.admin:
                        return Held(device.device, other)
        return None

    def prepare(self, claim: PreparedClaim) -> "Ledger | Held":
        """The ledger with this claim, in place of what it had before; or who is in the way."""
        blocker = self.find_holder(claim)
        return blocker or Ledger(claims={**self.claims, claim.uid: claim})

    def release(self, uids: Collection[str]) -> "Ledger":
        """The ledger without these claims; claims that it does not have are released already."""
        return Ledger(claims={uid: claim for uid, claim in self.claims.items() if uid not in uids})

    @property
    def device_ids(self) -> frozenset[str]:
        """Devices that containers may have."""
        return frozenset(device.device for claim in self.claims.values() for device in claim.devices)


def claims_of_earlier_boots(claims: Iterable[PreparedClaim], boot_id: str) -> list[PreparedClaim]:
    """Claims of which no container runs: these may be released when the API server does not know them any more."""
    return [claim for claim in claims if claim.boot_id != boot_id]
