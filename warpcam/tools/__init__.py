"""The command line: rendering, diagnosis, self-test."""
