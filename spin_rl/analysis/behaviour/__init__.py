"""What a policy does with camera and arm, and the behaviours that the paper calls emergent."""
