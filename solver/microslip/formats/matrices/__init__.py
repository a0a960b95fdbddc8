"""Matrices of other programs, a file a format; read.py knows them all."""
