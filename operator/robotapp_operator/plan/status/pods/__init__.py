"""Why pods do not run."""
