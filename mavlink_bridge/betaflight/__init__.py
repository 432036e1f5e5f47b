"""A Betaflight flight controller over MSP as a MAVLink vehicle."""
