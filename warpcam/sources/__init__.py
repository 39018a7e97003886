"""Simulators: each module reads one through its public API, and nothing else here imports a simulator."""
