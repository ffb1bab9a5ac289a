"""The page of measurements is made from files and nothing else."""

from pathlib import Path
from xml.etree import ElementTree as ET

from campaigns.speed.contestants import BARE, KUBE_SCHEDULER, OURS
from campaigns.speed.page import BEGIN, DOCS, END, main, replaced
from campaigns.speed.result import Result, Row
from campaigns.speed.verdict import CPU, RATE
from campaigns.speed.workloads import WORKLOADS


def measured(workload: str, ours: float) -> Row:
    row = Row(workload)
    for name, rate in ((OURS.name, ours), (KUBE_SCHEDULER.name, 100.0), (BARE.name, 1000.0)):
        row.add(name, 10, {RATE: rate, CPU: 1.0})
    return row


def test_the_page_keeps_what_stands_outside_the_marks(tmp_path: Path) -> None:
    page, file = tmp_path / "performance.md", tmp_path / "out.json"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    options = {"nodes": 5000, "prebound": 30000, "rounds": 2}
    Result("scripts/bench scheduler", options, {"cores": "2"}, [measured("basic", 900), measured("churn", 10)]).write(
        file
    )
    assert main([str(file), f"--page={page}", f"--chart={tmp_path / 'chart.svg'}"]) == 0
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "scripts/bench scheduler" in text
    assert f"| {WORKLOADS['basic'].text} | 900 | 100 | 9 | 2.5 | 1,000 | 90% | - | CPU 1/1.0 instead of 1/10 |" in text
    assert "0.1 times instead of 2" in text
    ET.parse(tmp_path / "chart.svg")  # noqa: S314 - our own file


def test_our_page_has_the_marks() -> None:
    assert "new" in replaced((DOCS / "performance.md").read_text(), "new")
