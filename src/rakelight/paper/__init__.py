"""The paper's experiment on our captures: one file per table.

Paper: "improving shape transformations for RGB cameras using photometric stereo".
"""
