"""Deployment to boards: the bundle, its transport, and the installer that runs on the board."""
