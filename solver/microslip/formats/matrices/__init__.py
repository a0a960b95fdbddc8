"""Readers of other programs' matrices, one module per format; read.py selects the reader."""
