"""Whatever the files of a node hold: never an error, and nothing that the schema would refuse."""

import json

from hypothesis import given
from hypothesis import strategies as st
from tests.support.agent.agents import readings

from robotapp_agent.report.load import Sample, Traffic, cpu_times, gpu_percent, load_between, memory_percent
from robotapp_agent.report.power import Sensor, battery, temperatures
from robotapp_agent.report.status import patch_of, status_of
from robotapp_api.model.telemetry import TelemetryStatus

numbers = st.one_of(st.integers(-(2**70), 2**70).map(str), st.text(max_size=12))
lines = st.lists(numbers, max_size=12).map(" ".join)
texts = st.one_of(st.text(max_size=80), lines, lines.map("cpu {}".format), numbers.map("MemTotal: {} kB".format))
counters = st.dictionaries(
    st.text(max_size=4), st.builds(Traffic, st.integers(0, 2**64), st.integers(0, 2**64)), max_size=3
)
samples = st.builds(
    lambda at_s, stat, memory, traffic, gpu: Sample(
        at_s,
        cpu=cpu_times(stat),
        memory_percent=memory_percent(memory),
        gpu_percent=gpu_percent(amdgpu=gpu, tegra=gpu, devfreq=gpu),
        traffic=traffic,
    ),
    st.floats(0, 1e9),
    texts,
    texts,
    counters,
    st.lists(texts, max_size=3),
)
sensors = st.lists(st.builds(Sensor, st.text(max_size=90), numbers), max_size=20)
supplies = st.lists(
    st.dictionaries(
        st.sampled_from(
            ["type", "scope", "online", "status", "capacity", "energy_now", "energy_full", "charge_now", "charge_full"]
        ),
        st.one_of(numbers, st.sampled_from(["Battery", "Mains", "Device", "Charging", "1", "80", "50000000"])),
    ),
    max_size=4,
)


@given(samples, samples, sensors, sensors, supplies)
def test_any_text_gives_a_status_of_the_schema(
    before: Sample, after: Sample, zones: list[Sensor], monitors: list[Sensor], cells: list[dict[str, str]]
) -> None:
    found = readings(
        load=load_between(before, after), temperatures=temperatures(zones, monitors), battery=battery(cells)
    )
    sent = json.loads(patch_of(status_of(found)))["status"]
    TelemetryStatus.model_validate({key: value for key, value in sent.items() if value is not None})
    names = [reading["name"] for reading in sent["temperatures"] or ()]
    assert len(names) == len(set(names))
    assert 0 <= ((sent["load"] or {}).get("networkBps") or 0) < 2**63
