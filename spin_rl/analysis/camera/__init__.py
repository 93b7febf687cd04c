"""What a policy's camera motion is worth."""
