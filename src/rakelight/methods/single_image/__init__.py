"""Methods for one photograph: shape from shading, with the sensor's depth as a prior."""
