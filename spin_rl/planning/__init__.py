"""Path search in a scene, which shares no code with the generators that it checks."""
