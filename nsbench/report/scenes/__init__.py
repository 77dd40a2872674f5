"""Draw pictures of cases and trajectories: particles with walls and links, planar paths, curves."""
