"""What can be found wrong with a spec by reading it alone: for the operator's `Accepted` and for `kubectl robotapp lint`."""
