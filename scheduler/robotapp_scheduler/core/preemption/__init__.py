"""Which pods go for a pod that fits nowhere."""
