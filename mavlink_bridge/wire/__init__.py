"""What crosses the wire: messages, MAVLink 2, links, video frames."""
