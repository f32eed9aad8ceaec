"""The engine: numpy, cv2 and numba only; no input or output, no logging, no clock."""
