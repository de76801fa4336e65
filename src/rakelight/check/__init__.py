"""Whether a capture can be right: one file per question, findings with remedies.

A check takes a `Measured` and returns `Finding`s, or raises CaptureError where the capture is wrong
beyond doubt.  `findings.py` is the table of all that is said.
"""
