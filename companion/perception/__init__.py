"""What is seen in one frame: neighbours, trunks and other surfaces, in the camera's frame."""
