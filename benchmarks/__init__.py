"""The benchmark suite: warpcam beside its peers, on the same scenes, poses, cameras and outputs."""
