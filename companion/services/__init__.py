"""What a companion owes the other components on the line: identity, figures, goals, commands."""
