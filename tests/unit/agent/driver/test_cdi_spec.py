"""What the container runtime is told to add."""

from tests.support.agent.dra import ADAPTER, NODE, can_bus, device, prepared

from robotapp_agent.devices.device import Device
from robotapp_agent.driver.rules.cdi_spec import DeviceFile, cdi_id, files_of, spec_of
from robotapp_agent.driver.rules.ledger import PreparedClaim, PreparedDevice

USB0 = DeviceFile("/dev/ttyUSB0")


def with_device(**fields: str) -> PreparedClaim:
    one = PreparedDevice(**{"request": "lidar", "pool": NODE, "device": ADAPTER, "variable": "V", **fields})
    claim = prepared()
    return PreparedClaim(uid=claim.uid, namespace="fleet", name="driver", boot_id="b", devices=(one,))


def edits(claim: PreparedClaim, one: Device, *files: DeviceFile) -> dict[str, object]:
    spec = spec_of(claim, {one.id: one}, {one.id: files})
    assert spec is not None
    (entry,) = spec["devices"]
    assert cdi_id(claim, claim.devices[0]) == f"{spec['kind']}={entry['name']}"
    edits_of_container: dict[str, object] = entry["containerEdits"]
    return edits_of_container


def test_a_device_file_is_open_to_every_user_of_the_container() -> None:
    assert edits(with_device(), device(), USB0) == {
        "env": ["V=/dev/ttyUSB0"],
        "deviceNodes": [{"path": "/dev/ttyUSB0", "hostPath": "/dev/ttyUSB0", "permissions": "rw", "fileMode": 0o666}],
    }


def test_a_device_is_found_at_the_path_of_the_users_choice() -> None:
    given = edits(with_device(mount_as="/dev/lidar"), device(), USB0)
    assert given["env"] == ["V=/dev/lidar"]
    assert given["deviceNodes"] == [
        {"path": "/dev/lidar", "hostPath": "/dev/ttyUSB0", "permissions": "rw", "fileMode": 0o666}
    ]


def test_a_pseudo_terminal_is_mounted_and_its_group_given() -> None:
    given = edits(with_device(), device(), DeviceFile("/dev/pts/3", terminal=True, gid=20))
    assert given == {
        "env": ["V=/dev/ttyUSB0"],
        "mounts": [
            {
                "hostPath": "/dev/pts/3",
                "containerPath": "/dev/ttyUSB0",
                "type": "bind",
                "options": ["bind", "rw", "nosuid", "noexec"],
            }
        ],
        "additionalGids": [20],
    }


def test_groups_need_a_later_version_of_cdi_which_is_asked_for_only_then() -> None:
    plain = spec_of(with_device(), {ADAPTER: device()}, {ADAPTER: [USB0]})
    terminal = spec_of(with_device(), {ADAPTER: device()}, {ADAPTER: [DeviceFile("/dev/pts/3", True, 20)]})
    assert plain is not None
    assert terminal is not None
    assert (plain["cdiVersion"], terminal["cdiVersion"]) == ("0.6.0", "0.7.0")


def test_a_network_interface_is_told_by_its_name_alone() -> None:
    assert edits(with_device(device="can-can0"), can_bus()) == {"env": ["V=can0"]}


def test_several_devices_of_a_request_share_its_variable() -> None:
    claim = prepared("driver", "serial-a", "serial-b")
    devices = {name: device(name, path=f"/dev/{name}") for name in ("serial-a", "serial-b")}
    spec = spec_of(claim, devices, {name: [DeviceFile(f"/dev/{name}")] for name in devices})
    assert spec is not None
    variables = [entry["containerEdits"]["env"] for entry in spec["devices"]]
    assert variables == [["ROBOTAPP_DEVICE_LIDAR=/dev/serial-a,/dev/serial-b"]] * 2
    assert len({entry["name"] for entry in spec["devices"]}) == 2


def test_there_is_no_spec_while_a_device_is_away() -> None:
    assert spec_of(with_device(), {}, {}) is None
    assert spec_of(with_device(), {ADAPTER: device(present=False)}, {ADAPTER: [USB0]}) is None
    assert spec_of(with_device(), {ADAPTER: device()}, {ADAPTER: []}) is None


def test_a_sound_card_comes_with_its_streams() -> None:
    card = device("sound-pch", path="/dev/snd/controlC1")
    names = ["controlC0", "controlC1", "hwC1D0", "pcmC0D0p", "pcmC1D0c", "pcmC1D0p", "pcmC11D0p", "seq", "timer"]
    expected = ("/dev/snd/controlC1", "/dev/snd/hwC1D0", "/dev/snd/pcmC1D0c", "/dev/snd/pcmC1D0p")
    assert files_of(card, names) == expected
    assert files_of(can_bus(), names) == ()
