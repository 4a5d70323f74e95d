"""What an operator wants to know before the boat leaves: asked of vehicle, probe, disk and shore, judged in one go."""
