"""Assets: URDF and MJCF files as Isaac Gym reads them."""
