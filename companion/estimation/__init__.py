"""What is known over time: own state, neighbours, obstacles, delay, hover thrust, link quality."""
