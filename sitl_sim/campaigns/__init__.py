"""Many flights: campaigns, studies and soaks, their tables and pages."""
