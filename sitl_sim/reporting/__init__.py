"""What one flight was like: figures, events, the page of a run."""
