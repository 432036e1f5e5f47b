"""Messages, their MAVLink 2 encoding, links, and video frames."""
