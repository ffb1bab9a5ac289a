"""Recordings: topics of the app that are written into bags."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from robotapp_api.model.app.component import Tier
from robotapp_api.model.base import Model
from robotapp_api.model.markers import Core, ListSet, Rule
from robotapp_api.model.packed import PackedMap
from robotapp_api.model.scalars import DnsLabel, DnsName, Duration, Image, Quantity, TopicName

TopicPattern = Annotated[str, StringConstraints(min_length=1, max_length=256)]


class RecordedTopics(Model):
    """Topics that are recorded: those that are named, and those whose whole name matches the regular expression."""

    RULES = (
        Rule(
            rule="has(self.names) || has(self.regex)",
            message='nothing would be recorded; write names, such as [/scan], or regex, such as "/camera/.*" (".*" for all)',
        ),
    )

    names: Annotated[tuple[TopicName, ...], ListSet(), Field(max_length=64)] = ()
    """Topics by their full name, such as /scan."""
    regex: TopicPattern | None = None
    """Regular expression of Python, such as /camera/.*; ".*" records every topic."""
    exclude: TopicPattern | None = None
    """Regular expression of topics that are left out, such as /rosout|/camera/.*/compressed."""


class RecordingSplit(Model):
    """Bounds of a bag, at which the next one is begun."""

    size: Quantity = "256Mi"
    """Size of a bag."""
    duration: Duration | None = None
    """Age of a bag; absent means that only its size counts."""


class RecordingRetain(Model):
    """Bound of all bags together."""

    size: Quantity = "5Gi"
    """What all bags of an instance's recording may take together; the oldest are deleted. At least twice split.size."""


class RecordingVolume(Model):
    """Volume that holds the bags."""

    claim_name: DnsName
    """PersistentVolumeClaim of this namespace. Each instance and recording has a folder of its own in it."""


class Recording(Model):
    """One recording: it becomes a component of this name, which writes the topics into MCAP files."""

    name: DnsLabel
    """Name of the recording, and of its component; no component of the app has it."""
    topics: RecordedTopics
    """Which topics are recorded. Each is subscribed to with the quality of service that its publishers offer."""
    split: RecordingSplit = RecordingSplit()
    """When a bag is closed and the next one begun."""
    retain: RecordingRetain = RecordingRetain()
    """What is kept; a recording never fills its volume."""
    volume: RecordingVolume | None = None
    """Where bags are kept; absent means in the pod, so they go with it."""
    tiers: Annotated[tuple[Tier, ...], Field(max_length=3)] = ()
    """Tiers of nodes it may run on, best first, as runsOn of a component: Robot, Edge, Cloud. Absent means any."""
    image: Image | None = None
    """Image with the recorder and the message packages of the topics; absent means the chart's helperImages.recorder."""
    image_pull_policy: (
        Annotated[Literal["Always", "IfNotPresent", "Never"], Core("Container", "imagePullPolicy")] | None
    ) = None
    """When the image is pulled: Always, IfNotPresent or Never."""
    resources: Annotated[PackedMap, Core("Container", "resources")] = PackedMap()
    """CPU and memory of the recorder; absent means 100m and 128Mi, at most 1 and 1Gi."""
