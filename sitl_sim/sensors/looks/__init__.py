"""Looks of a world and of its drones: data, the textures they are made of, the renderer."""
