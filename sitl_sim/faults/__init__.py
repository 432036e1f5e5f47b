"""What can go wrong in a flight, and how it is laid on."""
