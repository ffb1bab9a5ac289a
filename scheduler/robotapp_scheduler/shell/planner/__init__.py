"""Joint plans in a process beside the scheduler."""
