"""What cameras see: rendered pictures, depth, or a perfect detector's report."""
