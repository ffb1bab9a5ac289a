"""What the scheduler watches; used by the process, the export and the simulation."""
