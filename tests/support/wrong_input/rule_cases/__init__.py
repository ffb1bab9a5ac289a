"""One or more cases for every CEL rule: an object the rule accepts, one it refuses, and what it says then.

Evaluated twice: by a CEL library in unit tests and by the real API server in integration tests.
"""

from tests.support.wrong_input.rule_cases.app import APP
from tests.support.wrong_input.rule_cases.case import RuleCase
from tests.support.wrong_input.rule_cases.component import COMPONENT
from tests.support.wrong_input.rule_cases.others import CLAIM, INSTANCE, POOL

CASES = {"RobotApp": [*APP, *COMPONENT], "RobotAppInstance": INSTANCE, "RobotClaim": CLAIM, "DomainPool": POOL}

__all__ = ["CASES", "RuleCase"]
