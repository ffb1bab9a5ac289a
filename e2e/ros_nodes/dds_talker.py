"""A talker of Cyclone DDS with the names and types that ROS 2 has on the wire: python3 -m ros_nodes.dds_talker TOPIC."""

import os
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from ros_nodes.connect import end_on_request
from ros_nodes.messages import String

_RELIABLE = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))


def main(topic: str) -> None:
    end_on_request()
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    writer = DataWriter(participant, Topic(participant, f"rt{topic}", String), qos=_RELIABLE)
    number = 0
    while True:
        if not os.path.exists("/tmp/silence"):  # noqa: PTH110, S108 - within the container
            number += 1
            writer.write(String(data=str(number)))
        time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1])
