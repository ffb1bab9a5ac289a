"""Files of the host that devices are found in, and the admin's rules for them."""
