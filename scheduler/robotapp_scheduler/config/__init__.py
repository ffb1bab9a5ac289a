"""The configuration, its checks and the flags."""
