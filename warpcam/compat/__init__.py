"""Cameras in other systems' words: each module or package here stands in for one of theirs."""
