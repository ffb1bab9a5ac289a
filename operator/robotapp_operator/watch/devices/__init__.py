"""What a DRA driver publishes and hands over: ResourceSlices and ResourceClaims."""
