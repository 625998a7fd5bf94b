"""Meshes with named regions and surfaces, read from gmsh files or built from a geometry.

This room imports `support` and `geometry`.
"""
