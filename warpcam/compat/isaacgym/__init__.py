"""Isaac Gym's cameras, with no graphics: ``from warpcam.compat.isaacgym import gymapi, gymtorch``."""
