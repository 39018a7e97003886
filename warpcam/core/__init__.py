"""Modules that every other room may use: errors, devices, arrays, colours, rotations, torch interoperation."""
