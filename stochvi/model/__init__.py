"""The numbers that every method reads: a scene, lowered once."""
