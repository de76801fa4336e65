"""Cameras, the masked pixel grid, normals of a depth map, meshes."""
