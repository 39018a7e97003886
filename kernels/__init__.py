"""Device code: Warp kernels and the native headers they call. Imports warp and nothing of warpcam's upper floors."""
