"""Whether a capture can be right: one file per question, findings with remedies.

A check returns `Finding`s, or raises CaptureError where the capture is wrong beyond doubt.
"""
