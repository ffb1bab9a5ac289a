"""The scheduler's configuration as a form: from YAML to fields and back, checked by the scheduler's own loader."""
