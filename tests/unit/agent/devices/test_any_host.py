"""Discovery on hosts that nobody built: whatever the files are, it ends, tells what fits the API and leaves nothing open."""

import shutil
import tempfile
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.support.seeds import count_examples
from tests.unit.agent.devices.host_files import Tree, snapshots, trees

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.discovery import discover
from robotapp_agent.devices.rules import Match, Rule, Rules
from robotapp_agent.devices.tree import Entry, Snapshot
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths
from robotapp_api.model.telemetry import TelemetryDevice
from robotapp_testbed.machines.fake_host import FakeHost

SOME_RULES = Rules(
    devices=(
        Rule(match=Match(name=".*"), names=("sensor-usb-cam",), model="any"),
        Rule(match=Match(type="serial"), type="lidar", id="front"),
        Rule(match=Match(subsystem="hidraw"), type="tool", interface="left"),
        Rule(match=Match(attributes={"idVendor": "046.*"}), ignore=True),
    )
)


def open_files() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def check(devices: tuple[Device, ...]) -> None:
    """Every device is one that the API server takes."""
    for device in devices:
        TelemetryDevice.model_validate({name: getattr(device, name) for name in device.__struct_fields__})
        assert device.id.encode().isascii()
    assert len({device.id for device in devices}) == len(devices)


@settings(max_examples=count_examples(200))
@given(snapshots(), st.sampled_from([Rules(), SOME_RULES]))
def test_any_snapshot_gives_devices_that_the_api_takes(snapshot: Snapshot, rules: Rules) -> None:
    check(discover(snapshot, rules).devices)


@given(snapshots(), st.randoms(use_true_random=False))
def test_the_order_in_which_the_kernel_lists_entries_changes_no_id(snapshot: Snapshot, choice: object) -> None:
    entries = {(entry.subsystem, entry.name): entry for entry in snapshot.entries}  # a folder has one entry of a name
    snapshot = Snapshot(entries=tuple(entries.values()), folders=snapshot.folders)
    mixed: list[Entry] = list(snapshot.entries)
    choice.shuffle(mixed)  # type: ignore[attr-defined]  # a random.Random that hypothesis records
    assert discover(snapshot).devices == discover(Snapshot(entries=tuple(mixed), folders=snapshot.folders)).devices


@settings(
    max_examples=count_examples(200),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    deadline=None,
)
@given(trees())
def test_any_tree_of_files_is_scanned_without_harm(tree: Tree) -> None:
    root = Path(tempfile.mkdtemp())
    try:
        host = FakeHost(root)
        host.camera("1-2")
        tree.write(root)
        before = open_files()
        scanner = DeviceScanner(HostPaths.below(root))
        for _ in range(2):
            check(scanner.scan().devices)
        assert open_files() == before
    finally:
        shutil.rmtree(root)
