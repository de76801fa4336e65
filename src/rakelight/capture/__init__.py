"""Captures: read strictly from folders and recordings, written whole or not at all."""

from rakelight.capture.folder import CAPTURE, SYNTHETIC, load_depth, write_capture
from rakelight.capture.load import load_capture
from rakelight.capture.truth import has_truth, load_truth

__all__ = [
    "CAPTURE",
    "SYNTHETIC",
    "has_truth",
    "load_capture",
    "load_depth",
    "load_truth",
    "write_capture",
]
