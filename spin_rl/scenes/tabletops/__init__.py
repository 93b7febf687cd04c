"""Tables with an object to pick up, generated on the device."""
