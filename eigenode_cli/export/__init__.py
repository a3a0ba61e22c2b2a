"""The learned vector field for use elsewhere: as a file of torch, ONNX, C, or as an FMU."""
