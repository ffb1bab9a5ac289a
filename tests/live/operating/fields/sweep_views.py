"""A sweep as its tests look at it: phases, Jobs, and the answers of the command line."""

import subprocess
import sys
from pathlib import Path
from typing import Any

from campaigns.rigs.live import Tenant
from robotapp_api.model.names import Label

PROGRAM = Path(sys.executable).parent / "kubectl-robotapp"


def phases_of(tenant: Tenant, name: str) -> list[str]:
    """Returns the phases of the instances of an app."""
    return [str((item.get("status") or {}).get("phase", "")) for item in tenant.instances(name)]


def jobs_of(tenant: Tenant) -> dict[str, dict[str, Any]]:
    """Returns the Jobs of a namespace by their instance, for sweeps with one job each."""
    return {job["metadata"]["labels"][Label.INSTANCE]: job for job in tenant.listed("batch/jobs")}


def run_command(tenant: Tenant, *arguments: str) -> str:
    """Runs kubectl-robotapp as the administrator in the namespace, and returns what it printed. It must succeed."""
    command = [str(PROGRAM), *arguments, "-n", tenant.namespace, f"--kubeconfig={tenant.cp.kubeconfig('admin')}"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout
