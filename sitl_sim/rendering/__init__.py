"""Pictures and depth images of the world, as a fisheye camera would take them."""
