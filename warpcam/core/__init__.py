"""Errors, devices, arrays and torch interoperation: what every other room may use."""
