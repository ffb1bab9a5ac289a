"""etcd goes back to an older snapshot under running processes. Its own control plane: others must not suffer."""

import pytest

from campaigns.restore import restore
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane import product

pytestmark = pytest.mark.live


def test_after_a_restore_nobody_is_blind_and_ids_that_were_granted_since_go_to_nobody_else() -> None:
    with ControlPlane() as cp:
        product.install(cp)
        outcome = restore.run(cp, apps=9)
    assert outcome.failures == []
    assert outcome.restarts == {"operator": 1, "scheduler": 1}
