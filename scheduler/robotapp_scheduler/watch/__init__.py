"""What the scheduler watches, for the process, the export and the simulation alike."""
