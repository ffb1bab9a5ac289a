"""The claim protocol, state by state, with the product's own decision functions; mutants of each must be caught."""

import pytest
from tests.support.seeds import choose_for_today

from campaigns.claims.model.device import DeviceModel
from campaigns.claims.model.domain import DomainModel
from campaigns.claims.model.domain_rules import AUTO, DomainRules
from campaigns.claims.model.explore import explore
from campaigns.claims.model.scenarios import ALL, IN_TURN, Scenario
from robotapp_claims.rules.domain import DomainPlan

quick = [scenario for name, scenario in ALL.items() if scenario.quick and name not in IN_TURN]


@pytest.mark.parametrize("scenario", quick, ids=lambda scenario: scenario.name)
def test_the_protocol_gets_the_verdict_it_must_get(scenario: Scenario) -> None:
    result = scenario.run()
    assert result.verdict in scenario.expect, str(result)


@pytest.mark.parametrize("name", choose_for_today(IN_TURN))
def test_a_third_of_the_larger_scenarios_gets_its_verdict_each_day(name: str) -> None:
    scenario = ALL[name]
    result = scenario.run()
    assert result.verdict in scenario.expect, str(result)


def test_every_scenario_of_a_rule_as_built_expects_no_violation() -> None:
    built = [scenario for name, scenario in ALL.items() if name[0] in "RDCJ" and name[1].isdigit() and name != "R9"]
    assert len(built) >= 32
    assert {word for scenario in built for word in scenario.expect} == {"OK"}


def test_a_violation_comes_with_the_steps_that_lead_to_it() -> None:
    result = ALL["DM6"].run()
    assert result.trace[-1].startswith("Unreserve")
    assert "Unreserve" in str(result)


def test_a_model_in_which_nothing_can_happen_is_stuck() -> None:
    class Lazy(DomainRules):
        def plans(self, *_: object) -> tuple[DomainPlan, ...]:  # type: ignore[override]  # an operator that never decides
            return ()

    model = DomainModel(apps=(0,), names=(0,), begin="L", wants=(AUTO,), ids=1, changes=0, rules=Lazy())
    assert explore(model).verdict == "STUCK"


def test_too_many_states_are_an_error_and_not_a_pass() -> None:
    with pytest.raises(MemoryError, match="too big"):
        explore(DeviceModel(), cap=100)
