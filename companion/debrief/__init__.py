"""What flight logs tell of a flight when it is over, without a simulator's truth."""
