"""Trajectories: episodes of batched worlds as datasets, and demonstrations replayed into images."""
