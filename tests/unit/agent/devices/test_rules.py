"""The admin's file: what a rule matches, what it sets, and what is said about a file that is wrong."""

import re
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotapp_agent.devices.device import Device
from robotapp_agent.devices.patterns import matches, problem_of
from robotapp_agent.shell.device_scanner import DeviceScanner, HostPaths, Scan
from robotapp_agent.shell.host.rules_file import rules_of_text
from robotapp_testbed.machines.fake_host import LIDAR, FakeHost, UsbModel

NUMBERED = UsbModel("046d", "082d", "C920", serial="5F1A33BF")


def scanned(host: FakeHost, rules: str, *, node: str = "amr-07") -> Scan:
    path = host.root / "devices.yaml"
    path.write_text(rules)
    return DeviceScanner(HostPaths.below(host.root), rules_path=path, node=node).scan()


def only(scan: Scan) -> Device:
    (device,) = scan.devices
    assert scan.problem == ""
    return device


def test_a_rule_gives_a_camera_the_name_the_thesis_asks_by(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", NUMBERED)
    rules = """
    devices:
    - match: {type: video, attributes: {idVendor: "046d", product: "C9.*"}}
      model: front
      names: [sensor-usb-cam]
    """
    device = only(scanned(host, rules))
    assert (device.id, device.model, device.names) == ("video-046d-082d-5f1a33bf", "front", ("usb", "sensor-usb-cam"))


def test_a_rule_may_set_type_interface_and_id_and_later_rules_win(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2")
    rules = """
    devices:
    - {match: {name: "video.*"}, type: eye, interface: left, id: left}
    - {match: {path: ".*/1-2/.*"}, id: left-eye}
    """
    device = only(scanned(host, rules))
    assert (device.id, device.type, device.interface) == ("eye-left-eye", "eye", "left")


def test_an_id_of_a_rule_makes_a_device_without_serial_the_same_in_every_port(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    rules = 'devices: [{match: {attributes: {idProduct: "082d"}}, id: only-one}]'
    usb = host.camera("1-2")
    before = only(scanned(host, rules))
    host.remove(usb)
    host.camera("1-3")
    assert only(scanned(host, rules)) == before


def test_an_id_that_fits_two_devices_is_given_to_none_and_told(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", first=0)
    host.camera("1-3", first=2)
    scan = scanned(host, 'devices: [{match: {attributes: {idProduct: "082d"}}, id: only-one}]')
    assert [device.id for device in scan.devices] == ["video-046d-082d-00-14-0-2", "video-046d-082d-00-14-0-3"]
    assert "video-only-one of a rule fits several devices" in scan.problem


def test_what_is_ignored_is_told_under_no_other_type_either(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2", NUMBERED)
    assert scanned(host, "devices: [{match: {type: video}, ignore: true}]").devices == ()


def test_a_rule_for_one_robot_leaves_the_others_alone(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2")
    rules = 'devices: [{match: {node: "amr-.*", type: video}, model: front}]'
    assert only(scanned(host, rules)).model == "front"
    assert only(scanned(host, rules, node="arm-1")).model == "HD-Pro-Webcam-C920"


def test_a_rule_finds_devices_of_a_subsystem_the_agent_does_not_know(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    usb = host.usb("1-2", LIDAR)
    host.device(f"{host.function(usb)}/0003/hidraw/hidraw0", links=("class/hidraw",))
    assert only(scanned(host, "")).type == "usb"
    rules = "devices: [{match: {subsystem: hidraw, attributes: {product: Spinning.*}}, type: lidar}]"
    device = only(scanned(host, rules))
    assert device == Device(
        id="lidar-10c4-fff0-00-14-0-2",
        type="lidar",
        model="Spinning-Lidar",
        identity="10c4:fff0",
        path="/dev/hidraw0",
        names=("usb",),
    )


def test_a_rule_may_match_what_udev_knows(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.adapter("1-1", "ttyUSB0")
    host.properties("188:0", ID_USB_DRIVER="ftdi_sio")
    rules = "devices: [{match: {properties: {ID_USB_DRIVER: ftdi.*}}, names: [lidar-front]}]"
    assert "lidar-front" in only(scanned(host, rules)).names


def test_while_a_file_is_wrong_the_rules_before_it_stay_and_it_is_said(tmp_path: Path) -> None:
    host = FakeHost(tmp_path)
    host.camera("1-2")
    path = tmp_path / "devices.yaml"
    scanner = DeviceScanner(HostPaths.below(tmp_path), rules_path=path)
    assert only(scanner.scan()).model == "HD-Pro-Webcam-C920"
    path.write_text("devices: [{match: {type: video}, model: front}]")
    assert only(scanner.scan()).model == "front"
    for wrong in ("devices: [", "devices: 3", "x" * 70_000, b"\xff\xfe".decode("latin-1")):
        path.write_text(wrong)
        scan = scanner.scan()
        assert [device.model for device in scan.devices] == ["front"]
        assert scan.problem.startswith(str(path)) or len(scan.problem) == 256
    path.write_text("")
    assert only(scanner.scan()).model == "HD-Pro-Webcam-C920"


def test_a_pipe_in_the_place_of_the_file_keeps_nobody_waiting(tmp_path: Path) -> None:
    import os

    host = FakeHost(tmp_path)
    host.camera("1-2")
    os.mkfifo(tmp_path / "devices.yaml")
    scan = DeviceScanner(HostPaths.below(tmp_path), rules_path=tmp_path / "devices.yaml").scan()
    assert len(scan.devices) == 1
    assert "no plain file" in scan.problem


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("devices:\n- match: {type: video}\n  modle: x\n", "line 2: devices[0]: Object contains unknown field `modle`"),
        ("devices:\n- match: {type: video}\n  model: a b\n", "line 3: devices[0].model: Expected `str` matching regex"),
        ("devices:\n- match:\n    attributes:\n      idVendor: 0403\n", "line 4: devices[0].match.attributes"),
        ("devices:\n- match: {}\n  model: x\n", "line 2: devices[0].match: a rule must match something"),
        ("devices:\n- model: x\n", "line 2: devices[0]: Object missing required field `match`"),
        ("devices:\n- match:\n    name: (a+)+\n", "line 3: devices[0].match.name: pattern '(a+)+': a group cannot be repeated"),
        ("devices:\n- match:\n    attributes:\n      product: '['\n", "line 4: devices[0].match.attributes.product: pattern"),
        ("devices:\n- match: {name: a}\n- match: {name: a}\n  match: {name: b}\n", 'line 4: key "match" already set'),
        ("devices:\n- {match: {name: a}\n", "line 3"),
        ("devices:\n- match: {name: a}\n  type: source\n", "line 3: devices[0].type: hardware.robotics.io/source is a label of"),
        ("- 1\n", "line 1: Expected `object`, got `array`"),
        ("devices: [{match: {name: a}, names: [a, b, c, d, e, f, g, h, i]}]", "line 1: devices[0].names"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told_with_its_line(text: str, said: str) -> None:
    rules, problem = rules_of_text(text, name="devices.yaml")
    assert rules is None
    assert said in problem, problem


def test_a_number_that_should_be_text_is_told_with_what_to_do() -> None:
    _, problem = rules_of_text("devices: [{match: {attributes: {idVendor: 0403}}}]", name="devices.yaml")
    assert 'write it in quotes, as "0403"' in problem


@given(st.text(max_size=200))
def test_any_text_is_rules_or_a_message(text: str) -> None:
    rules, problem = rules_of_text(text, name="devices.yaml")
    assert (rules is None) == bool(problem)


@pytest.mark.parametrize(
    "pattern",
    ["(a+)+", "(a*)*b", "(?:a|aa)+", "(x+x+)+y", r"(a)\1", "(?=a)a", "(?i)a", ".*.*.*.*", "a?" * 5, "(a|b)" * 5, "(", "[",
     "a{2}{3}", "a" * 129, "(a){2,}", "*"],
)  # fmt: skip
def test_a_pattern_that_may_take_for_ever_or_is_none_is_refused(pattern: str) -> None:
    assert problem_of(pattern)


@pytest.mark.parametrize(
    "pattern",
    ["C9.*", "ttyUSB[0-9]+", "046[dD]", "(front|rear) cam", r".*/1-2\.[34]/.*", "[]a]", r"a\*\+", "(?:x)?", "[*+]{4}"],
)
def test_a_plain_pattern_is_taken(pattern: str) -> None:
    assert problem_of(pattern) == ""


@given(st.text("ab()|?*+{},12[]^.\\:", max_size=40), st.sampled_from(["a" * 300, "ab" * 150, "a" * 255 + "!", ""]))
def test_no_pattern_that_is_taken_computes_long(pattern: str, text: str) -> None:
    """Beside the same process adding up numbers: a pattern that explodes would take the age of the universe."""
    if problem_of(pattern):
        return
    began = time.process_time()
    matches(pattern, text)
    took = time.process_time() - began
    began = time.process_time()
    sum(range(3_000_000))
    assert took < 100 * (time.process_time() - began) + 1


def test_the_worst_patterns_that_are_taken_stay_bounded() -> None:
    for pattern in (".*.*.*!", "a*a*a*!", "[a-z]*a[a-z]*a[a-z]*!", "(a*|aa)(a*|aa)a*!", "a?a?a?a?a*a*a*!"):
        assert problem_of(pattern) == "", pattern
        assert not matches(pattern, "a" * 1000)


@given(st.from_regex(re.compile(r"[a-c.*+?]{1,6}"), fullmatch=True), st.text("abc", max_size=12))
def test_a_pattern_matches_the_whole_text(pattern: str, text: str) -> None:
    if not problem_of(pattern):
        assert matches(pattern, text) == bool(re.fullmatch(pattern, text))
