"""How light, albedo and normals make a photograph, and back."""
