"""Other projects' own tests of the classes that front ends stand for: ``python -m tests.other_projects``."""
