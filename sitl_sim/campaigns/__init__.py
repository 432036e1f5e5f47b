"""Many flights: campaigns, studies, their tables and pages."""
