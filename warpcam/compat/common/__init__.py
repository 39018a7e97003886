"""Parts that several front ends share."""
