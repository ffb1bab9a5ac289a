"""A driver publishes the readings of a temperature sensor on a serial port, and a listener counts them."""
