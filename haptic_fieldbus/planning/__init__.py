"""Compilation of scene, rig and rate to the smallest loop for the scene."""
