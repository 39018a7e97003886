"""Camera sensors and their appearance settings."""
