"""One module per kind of attack; every function that `register` decorates is run by `scripts/bench hostile`."""
