"""Capture folders: read strictly, written whole or not at all."""

from rakelight.capture.folder import load_capture, write_capture
from rakelight.capture.truth import load_truth

__all__ = ["load_capture", "load_truth", "write_capture"]
