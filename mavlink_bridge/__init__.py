"""MAVLink, MSP and video on the wire, and what both ends of it share."""
