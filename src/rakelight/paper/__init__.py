"""The paper's experiment on our captures: one file per table and figure.

Paper: "improving shape transformations for RGB cameras using photometric stereo".
"""
