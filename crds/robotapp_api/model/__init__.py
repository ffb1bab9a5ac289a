"""Pure data: the four kinds of group robotics.io and the names every component shares."""
