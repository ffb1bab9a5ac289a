"""Why a pod went where it went."""
