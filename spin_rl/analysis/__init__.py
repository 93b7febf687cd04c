"""What a policy does and why it fails: the worth of its camera, and its failures."""
