"""All that crosses the wire: frames, messages, MAVLink, video, MSP."""
