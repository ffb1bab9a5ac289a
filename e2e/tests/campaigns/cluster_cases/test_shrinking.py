"""Small counter-examples: found, kept, and read again."""

from pathlib import Path
from typing import Any

from campaigns.cluster_cases import seeded_case
from campaigns.cluster_cases.regressions import keep, regressions
from campaigns.cluster_cases.shrinking import shrunk, size

Json = dict[str, Any]


def test_only_what_the_difference_needs_is_left() -> None:
    case = seeded_case("3", number=0, families=["taints"])

    def differs(objects: tuple[Json, ...]) -> bool:
        return "n1" in {each["metadata"]["name"] for each in objects} and "tolerations" in objects[-1]["spec"]

    assert differs(case.objects)
    small = shrunk(case.objects, differs, attempts=2000)
    assert differs(small)
    assert [each["kind"] for each in small] == ["Node", "Pod"]
    assert small[-1]["spec"] == {"tolerations": []}
    assert size(small) < 500


def test_a_kept_case_is_read_again_under_a_name_made_of_its_content(tmp_path: Path) -> None:
    case = seeded_case("3", number=0, families=["taints"])
    path = keep(case.objects, why="text", profile="-packed", folder=tmp_path)
    assert keep(case.objects, why="text", profile="-packed", folder=tmp_path) == path
    (found,) = regressions(tmp_path)
    assert (found.name, found.why, found.profile, found.objects) == (path.stem, "text", "-packed", case.objects)
    assert found.case.pod == case.pod
