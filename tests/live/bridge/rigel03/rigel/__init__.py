"""The package name that plugins import."""
