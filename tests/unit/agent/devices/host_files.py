"""Devices and trees of sysfs for property tests of the agent."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from robotapp_agent.devices.device import Device, device_id
from robotapp_agent.devices.tree import FOLDERS, USB_ATTRIBUTES, Entry, Snapshot
from robotapp_api.values.devices.words import AGENT_TYPES
from robotapp_api.values.naming import label_value

TEXTS = st.one_of(
    st.text(max_size=40),
    st.sampled_from(
        ["", "0", "1", "280", "046d", "0B3A", "09", "Y", "0001", "x" * 300, "\x00\n", "-", "é", "ffff 0 0 0 0"]
    ),
)
STEPS = st.one_of(
    st.sampled_from(
        ["pci0000:00", "0000:00:14.0", "usb1", "usb2", "1-2", "1-2.3", "1-2:1.0", "1-2:1.1", "video4linux", "video0",
         "tty", "ttyUSB0", "net", "can0", "input", "input3", "js0", "sound", "card0", "drm", "renderD128", "virtual",
         "xhci-hcd.0.auto", "i2c-1", "i2c-dev", "..", "", "1-", "1-2:1.", "platform", "x" * 200]
    ),
    st.text(max_size=12),
)  # fmt: skip
ATTRIBUTES = sorted({name for folder in FOLDERS for name in (*folder.attributes, *folder.parent_attributes)})


@st.composite
def devices(draw: st.DrawFn) -> Device:
    """Any device that discovery could answer."""
    kind = draw(st.sampled_from(AGENT_TYPES))
    return Device(
        id=device_id(kind, draw(TEXTS)),
        type=kind,
        model=label_value(draw(TEXTS)),
        interface=label_value(draw(TEXTS)),
        present=draw(st.booleans()),
        names=tuple(draw(st.lists(st.sampled_from(["usb", "sensor-usb-cam", "lidar"]), max_size=8, unique=True))),
    )


def snapshots() -> st.SearchStrategy[Snapshot]:
    """Any snapshot at all: texts and paths of no sense, functions of devices that are not there, everything twice."""
    paths = st.lists(STEPS, max_size=8).map(lambda steps: "/".join(["devices", *steps]))
    names = st.sampled_from(
        ["video0", "video1", "ttyUSB0", "can0", "input3", "js0", "card0", "renderD128", "usb1", "1-2"]
    )
    entries = st.builds(
        Entry,
        subsystem=st.sampled_from([*(folder.subsystem for folder in FOLDERS), "hidraw"]),
        name=st.one_of(
            names, st.text(st.characters(codec="ascii", categories=("L", "N", "P")), min_size=1, max_size=9)
        ),
        path=paths,
        attributes=st.dictionaries(st.sampled_from(ATTRIBUTES), TEXTS, max_size=6),
        parent_attributes=st.dictionaries(st.sampled_from(ATTRIBUTES), TEXTS, max_size=3),
        driver=TEXTS,
        properties=st.dictionaries(st.sampled_from(["ID_V4L_CAPABILITIES", "ID_MODEL"]), TEXTS, max_size=2),
    )
    hexadecimal = st.one_of(TEXTS, st.sampled_from(["046d", "082d"]))
    attributes = st.fixed_dictionaries({}, optional=dict.fromkeys(USB_ATTRIBUTES, hexadecimal))
    return st.builds(
        Snapshot,
        entries=st.lists(entries, max_size=12).map(tuple),
        folders=st.dictionaries(paths, attributes, max_size=6),
        marks=st.sampled_from([frozenset(), frozenset({"nvhost-gpu"})]),
        nvidia=st.lists(st.one_of(TEXTS, st.just("0000:01:00.0")), max_size=2).map(tuple),
    )


class Tree:
    """One tree of files, as hypothesis chooses it, below a folder that is there already."""

    def __init__(self, nodes: list[tuple[list[str], str, Any]]) -> None:
        self.nodes = nodes

    def __repr__(self) -> str:
        return f"Tree({self.nodes!r})"

    def write(self, root: Path) -> None:
        """What cannot be made, because something else is there or a link is on the way, is left out: never outside of root."""
        for steps, kind, content in self.nodes:
            path = root.joinpath(*steps)
            above = (root.joinpath(*steps[:end]) for end in range(1, len(steps) + 1))
            if os.path.lexists(path) or any(each.is_symlink() for each in above):
                continue
            with suppress(OSError, ValueError):
                path.parent.mkdir(parents=True, exist_ok=True)
                if kind == "file":
                    with path.open("xb") as file:  # what is there may be a pipe, which would wait for a reader
                        file.write(content)
                elif kind == "link":
                    path.symlink_to(content)
                elif kind == "pipe":
                    os.mkfifo(path)
                else:
                    path.mkdir()


def trees() -> st.SearchStrategy[Tree]:
    """Folders where files should be, pipes, links to themselves and out of the tree, bytes of no text."""
    folders = [folder.path.split("/") for folder in FOLDERS]
    plain = STEPS.filter(
        lambda step: step not in {"", ".", ".."} and "/" not in step and "\0" not in step and len(step) < 60
    )
    attribute = st.sampled_from([*ATTRIBUTES, *USB_ATTRIBUTES, "type", "driver", "dev"])
    steps = st.one_of(
        st.tuples(st.sampled_from(folders), plain).map(lambda pair: ["sys", *pair[0], pair[1]]),
        st.tuples(st.lists(plain, max_size=6), st.one_of(plain, attribute)).map(
            lambda pair: ["sys", "devices", *pair[0], pair[1]]
        ),
        st.tuples(plain).map(lambda pair: ["run", "udev", "data", pair[0]]),
        st.tuples(plain).map(lambda pair: ["proc", "driver", "nvidia", "gpus", pair[0]]),
        st.sampled_from([["sys", "class"], ["sys"], ["dev"], ["run", "udev"], ["dev", "nvgpu"]]),
    )
    target = st.one_of(
        st.lists(plain, min_size=1, max_size=7).map(lambda parts: "../../devices/" + "/".join(parts)),
        st.sampled_from([".", "..", "/", "/etc", "../../../../../../etc/passwd", "../../devices", "loop", "x" * 300]),
    )
    node = st.one_of(
        st.tuples(steps, st.just("link"), target),
        st.tuples(
            steps,
            st.just("file"),
            st.one_of(st.binary(max_size=64), TEXTS.map(lambda text: text.encode("utf-8", "replace"))),
        ),
        st.tuples(steps, st.sampled_from(["folder", "pipe"]), st.none()),
    )
    return st.lists(node, max_size=40).map(Tree)
