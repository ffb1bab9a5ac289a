"""Many apps and pods for few domains and devices, with deaths and forgeries, judged at every revision of the store."""
