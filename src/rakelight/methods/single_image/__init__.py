"""Methods for one photograph: shape from shading, held by the depth camera."""
